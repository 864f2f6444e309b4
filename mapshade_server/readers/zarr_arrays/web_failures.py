"""What goes wrong between here and a web server, in one line, and the requests that are left over then.

Zarr asks for many chunks at a time and gives up at the first failure. The others would go on, and Python would write
pages of traces about each when it finds that nobody waits for them.
"""

import json
import logging
import os
import socket
import ssl
import sys
from functools import cache
from http import HTTPStatus

from volsplat.mapshade_server.readers.reading.extra import library

CONNECT_SECONDS, ANSWER_SECONDS = 10, 60
CHECK = "check the place, or fetch the data again"
REFUSED = (HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN)
LEFT_OVER = ("Task was destroyed but it is pending", "exception was never retrieved", "Unclosed c")


def reason_and_cure(error: Exception) -> str:
    """Why something cannot be read, and what to do, without names of places."""
    chain: list[BaseException] = [error]
    while (before := chain[-1].__cause__ or chain[-1].__context__) is not None and before not in chain:
        chain.append(before)
    return next((told for one in chain if (told := _of_the_web(one))), None) or f"{_here(error)}; {CHECK}"


def _of_the_web(error: BaseException) -> str:
    """What a failure of the network means, "" for others."""
    status = getattr(error, "status", None)
    if isinstance(status, int) and status >= HTTPStatus.BAD_REQUEST:
        return _answered(status)
    match error:
        case TimeoutError():
            return f"no answer for {ANSWER_SECONDS} s; check the address and the network, or try again later"
        case ssl.SSLCertVerificationError():
            return f"the server's certificate is not trusted ({error.verify_message}); check the address"
        case ssl.SSLError():
            return "no secure connection can be made; check whether the address begins with http:// or https://"
        case socket.gaierror():
            return "there is no host of this name; check the address and the network"
        case ConnectionRefusedError():
            return "nothing answers at this address and port (connection refused); check the address"
        case ConnectionError():
            return "the connection broke off; try again"
    aiohttp = sys.modules.get("aiohttp")
    if aiohttp is not None and isinstance(error, aiohttp.ClientPayloadError | aiohttp.ServerDisconnectedError):
        return "the connection broke off; try again"
    return ""


def _answered(status: int) -> str:
    try:
        phrase = f"{status} {HTTPStatus(status).phrase}"
    except ValueError:
        phrase = str(status)
    if status in REFUSED:
        return f"the server refuses to give it ({phrase}); check the address, or ask for access"
    if status >= HTTPStatus.INTERNAL_SERVER_ERROR:
        return f"the server failed ({phrase}); try again later"
    return f"the server does not give it ({phrase}); {CHECK}"


def _here(error: BaseException) -> str:
    if isinstance(error, json.JSONDecodeError | UnicodeDecodeError):
        return "what is there is no Zarr metadata, but perhaps a page to log in"
    if isinstance(error, OSError) and error.errno and error.filename:
        return f"cannot be read ({os.strerror(error.errno)})"
    text = " ".join(str(error).split())
    return f"cannot be read ({text or type(error).__name__})"


def end_requests() -> None:
    """End what Zarr still waits for, and have nothing written of it."""
    drop_left_over()
    library("zarr.core.sync", "Zarr").sync(_cancel())


async def _cancel() -> None:
    import asyncio  # slow to import: a server that reads no Zarr starts without it

    others = asyncio.all_tasks() - {asyncio.current_task()}
    for task in others:
        task.cancel()
    await asyncio.gather(*others, return_exceptions=True)


@cache
def drop_left_over() -> None:
    """Have nothing written of tasks that nobody waits for any more: the failure itself is reported."""

    def is_news(record: logging.LogRecord) -> bool:
        return not any(text in record.getMessage() for text in LEFT_OVER)

    logging.getLogger("asyncio").addFilter(is_news)
