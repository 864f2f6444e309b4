"""Runs a server for as long as whoever started this holds its standard input open, whose first line is the token.

    python -m volsplat.deploy.launchers.tied_process COMMAND...

An engine may kill what it runs without a word; a server must not be left behind then.
"""

import os
import subprocess
import sys
import threading
from collections.abc import Sequence

from volsplat.deploy.process_end import told_end
from volsplat.protocol.wire.tokens import Token

GRACE_SECONDS = 3.0  # that it has to end by itself before it is killed


def tied_command(command: Sequence[str]) -> list[str]:
    return [sys.executable, "-m", "volsplat.deploy.launchers.tied_process", *command]


def main(command: Sequence[str]) -> int:
    environment = Token(sys.stdin.readline().strip()).added_to(os.environ)
    try:
        server = subprocess.Popen(command, env=environment, stdin=subprocess.DEVNULL)
    except OSError as error:
        print(f"{command[0]} cannot be run: {error.strerror}", flush=True)
        return 2
    threading.Thread(target=_end_with_input, args=(server,), name="end with the input", daemon=True).start()
    status = server.wait()
    print(f"it {told_end(status)}", flush=True)
    return abs(status)


def _end_with_input(server: "subprocess.Popen[bytes]") -> None:
    sys.stdin.read()
    server.terminate()
    try:
        server.wait(GRACE_SECONDS)
    except subprocess.TimeoutExpired:
        server.kill()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
