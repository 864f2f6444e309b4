"""What the programs log: lines on stderr that nothing in a name can steer, for a person or, as JSON, for a program."""

import json
import logging
import sys
import time
from enum import StrEnum

import click

from volsplat.program.this_machine import process_name
from volsplat.protocol.text.printable import one_line

log = logging.getLogger(__name__)

FORM_VARIABLE = "VOLSPLAT_LOG_FORMAT"  # in which servers of this machine hear of it
TOLD = ("session", "frame", "server")  # that an event may be about, by `extra`


class LogForm(StrEnum):
    TEXT = "text"
    JSON = "json"


log_format_option = click.option(
    "--log-format",
    type=click.Choice([form.value for form in LogForm]),
    default=LogForm.TEXT.value,
    envvar=FORM_VARIABLE,
    help="Log for a person (text), or each event with time, session and frame as JSON.",
)


class _Lines(logging.Formatter):
    """Makes each message one printable line; a traceback after it stays as it is."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        return one_line(super().formatMessage(record))


class _JsonLines(logging.Formatter):
    """Makes each event one line, whatever comes with it."""

    def __init__(self, title: str) -> None:
        super().__init__()
        self._title = title
        self.session = ""  # of a process that has one at a time

    def format(self, record: logging.LogRecord) -> str:
        moment = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(record.created))
        told: dict[str, object] = {
            "time": f"{moment}.{int(record.msecs):03}Z",
            "level": record.levelname.lower(),
            "program": self._title,
            "process": process_name(),
            "event": getattr(record, "event", record.module),
        }
        ids = {"session": self.session} | {key: vars(record)[key] for key in TOLD if key in vars(record)}
        told |= {key: value for key, value in ids.items() if value}
        told["message"] = one_line(record.getMessage())
        if record.exc_info:
            told["traceback"] = self.formatException(record.exc_info)
        return json.dumps(told)


def log_to_stderr(title: str, level: int, form: LogForm) -> None:
    """Have everything from `level` on logged as `title: message`, or as JSON, and then all that is informative."""
    handler = logging.StreamHandler()
    if form is LogForm.JSON:
        handler.setFormatter(_JsonLines(title))
        level = min(level, logging.INFO)
    else:
        handler.setFormatter(_Lines(f"{title}: %(message)s"))
    logging.basicConfig(level=level, handlers=[handler])


def name_session(session: str) -> None:
    """Log that this session is served, and all that comes as its: for processes that have one at a time."""
    for formatter in _json_formatters():
        formatter.session = session
    log.info("serving session %s", session, extra={"event": "session_begun"})


def log_frame(by: logging.Logger, event: str, frame: int, what: str) -> None:
    """Log what has become of a frame."""
    by.info("frame %d %s", frame, what, extra={"event": event, "frame": frame})


def say_last(title: str, line: str) -> None:
    """Say how a program ends, in the form of its log."""
    if _json_formatters():
        logging.getLogger(__name__).error("%s", line, extra={"event": "program_ended"})
    else:
        print(f"{title}: {one_line(line)}", file=sys.stderr, flush=True)


def _json_formatters() -> list[_JsonLines]:
    formatters = (handler.formatter for handler in logging.getLogger().handlers)
    return [formatter for formatter in formatters if isinstance(formatter, _JsonLines)]
