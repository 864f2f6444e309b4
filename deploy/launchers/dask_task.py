"""A server as a long task of a Dask worker, and what it says of itself there (see launchers/dask.py)."""

import subprocess
import threading
from collections.abc import Sequence
from typing import IO

from distributed import Event, Worker, get_worker

from volsplat.deploy.launchers.tied_process import tied_command
from volsplat.deploy.server_command import Program, server_command
from volsplat.protocol.wire.tokens import Token

LOOK_SECONDS = 1.0  # between two looks at whether it is to end
BEGUN, LINE = "begun", "line"  # what events say, as {kind: text}


def serve(name: str, program: Program, command: str, arguments: Sequence[str], token: Token) -> None:
    """Run a server until it ends or the event `name` is set, and forward what it prints to the topic `name`.

    It gets as many threads as the worker has, unless `arguments` say how many. An empty `command` is this Python's own.
    """
    worker = get_worker()
    threads = [] if "--threads" in arguments else ["--threads", str(worker.state.nthreads)]
    words = [*_called(program, command), *arguments, *threads]
    process = subprocess.Popen(
        tied_command(words), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    assert process.stdin is not None and process.stdout is not None
    forwarding = threading.Thread(target=_forward, args=(worker, name, process.stdout), name=f"log {name}", daemon=True)
    forwarding.start()
    worker.log_event(name, {BEGUN: worker.address})
    try:
        process.stdin.write(token.key.decode() + "\n")
        process.stdin.flush()
        _wait_for_the_end(process, Event(name))
    finally:
        process.stdin.close()
        process.wait()
        forwarding.join()


def _called(program: Program, command: str) -> list[str]:
    return [command, program.command] if command else server_command(program)


def _wait_for_the_end(process: "subprocess.Popen[str]", asked: Event) -> None:
    while process.poll() is None and not asked.wait(LOOK_SECONDS):
        pass


def _forward(worker: Worker, name: str, output: IO[str]) -> None:
    with output:
        for line in output:
            worker.log_event(name, {LINE: line.rstrip("\n")})
