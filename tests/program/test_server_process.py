"""What both server programs share as processes: how they end, and how they word what went wrong."""

import os
import subprocess
import sys

import pytest

from support.patience import PATIENCE
from volsplat.deploy.server_command import Program, server_command
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.refusals import OUT_OF_MEMORY, refusal
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.wire.listener import Listener
from volsplat.protocol.wire.tokens import new_token

TITLES = {Program.MAPSHADE_SERVER: "mapshade-server", Program.SPLAT_SERVER: "splat-server"}


@pytest.mark.parametrize("server", TITLES)
def test_the_program_ends_with_one_line_and_status_1_where_its_client_is_lost(server: Program) -> None:
    token = new_token()
    with Listener(Role.CLIENT, token) as clients:
        program = subprocess.Popen(
            server_command(server, "--connect", str(clients.address)),
            env=token.added_to(os.environ),
            stderr=subprocess.PIPE,
            encoding="utf-8",
        )
        control = clients.accept(PATIENCE)
        assert control is not None
        clients.close()  # else it would be dialled again
        control.close()
        _, said = program.communicate(timeout=PATIENCE)
    assert program.returncode == 1
    assert said.startswith(f"{TITLES[server]}: ") and said.count("\n") == 1


TURNED_AWAY = """
import sys
from volsplat.program import clients
from volsplat.program.server_process import ServerOptions
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.tokens import new_token

clients.REPEAT_PAUSE_SECONDS = 1e-3
tries = 0

def one():
    global tries
    tries += 1
    if tries > 10000:
        sys.exit("it goes on without end")
    raise BadInput("another session token")

options = ServerOptions(
    connect=Address("127.0.0.1", 1),
    wait_at=None,
    token=new_token(),
    patience=1.0,
    resident={resident},
    keep=0.1,
    encryption=Encryption.BETWEEN_MACHINES,
    silence=2.0,
    name="",
    metrics=None,
    wanted_threads=1,
    sharing=1,
)
try:
    clients.Clients(Role.SPLAT_SERVER, options).serve(one)
except BadInput as error:
    print(tries, error)
"""


@pytest.mark.parametrize("resident", [False, True])
def test_a_server_that_every_client_turns_away_ends_and_has_said_so_once(resident: bool) -> None:
    """A resident one only once it has been without a client for as long as it keeps what it holds."""
    script = TURNED_AWAY.format(resident=resident)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, encoding="utf-8", timeout=PATIENCE)
    tries, told = done.stdout.split(maxsplit=1)
    assert (done.returncode, told) == (0, "another session token\n")
    if resident:
        assert int(tries) > 1 and done.stderr == "another session token; looking for a client again\n"
    else:
        assert int(tries) == 1 and not done.stderr


LEAVING = """
import atexit, sys, threading
from volsplat.program.exit_status import quick_end

class Loaded:
    def __del__(self):
        print("taken_down")

def follow():
    threading.main_thread().join()
    print("thread")

loaded = Loaded()
atexit.register(print, "before")
with quick_end():
    atexit.register(print, "registered")
    threading.Thread(target=follow).start()
    {ending}
"""


@pytest.mark.parametrize(
    ("ending", "status", "said"),
    [
        ("sys.exit(3)", 3, "thread registered"),
        ("raise SystemExit", 0, "thread registered before taken_down"),
        ("raise ValueError", 1, "thread registered before taken_down"),
    ],
)
def test_a_program_that_leaves_has_its_status_and_ends_what_is_its_own(ending: str, status: int, said: str) -> None:
    done = subprocess.run([sys.executable, "-c", LEAVING.format(ending=ending)], capture_output=True, encoding="utf-8")
    assert (done.returncode, done.stdout.split()) == (status, said.split())


@pytest.mark.parametrize(
    ("error", "cause"),
    [
        (MemoryError(), OUT_OF_MEMORY),
        (ValueError("a line\nand \x1b[2J another"), "a line and ?[2J another"),
        (KeyError("x"), "internal error in volsplat, please report it: KeyError: 'x'"),
        (ValueError("x" * 5000), "x" * messages.LONGEST_LINE),
    ],
    ids=["memory", "control characters", "a mistake", "too long"],
)
def test_whatever_went_wrong_is_one_printable_line(error: Exception, cause: str) -> None:
    assert refusal(messages.AbortFrame(7), error) == messages.Refused("AbortFrame", cause, frame=7)
