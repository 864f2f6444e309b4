"""Numbers that help and the manual state are those that the programs go by."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import msgspec
import pytest

from support.checkout import ROOT
from volsplat.client.command.commands import volsplat
from volsplat.client.session.cluster_watch import JOINING_SECONDS, MISSING_SECONDS, UNHEARD_SECONDS
from volsplat.deploy.cluster.cluster_use import PATIENCE_SECONDS as TURN_SECONDS
from volsplat.deploy.cluster_file import Cluster, Machine
from volsplat.deploy.launchers.ssh import CONNECT_SECONDS
from volsplat.deploy.restart_limit import MOST_RESTARTS, RESTARTS_SECONDS
from volsplat.mapshade_server.command import mapshade_server
from volsplat.mapshade_server.prepare.command import prepare_command
from volsplat.program.departure import LEAVE_SECONDS, LEAVING_SILENCE
from volsplat.protocol.wire.dialling import PATIENCE_SECONDS
from volsplat.protocol.wire.framing import LARGEST_GREETING
from volsplat.protocol.wire.heartbeat import HELD, SIGNS_IN_SILENCE, SILENCE_SECONDS
from volsplat.protocol.wire.port import HANDSHAKE_SECONDS, MOST_PENDING
from volsplat.protocol.wire.tls_channel import MOST_HANDSHAKE_BYTES
from volsplat.splat_server.command import splat_server

DOCS = ROOT / "docs"
RELIABILITY, SECURITY = DOCS / "how_it_works" / "reliability.md", DOCS / "reference" / "security.md"
CLUSTER_FILE = DOCS / "reference" / "cluster_file.md"
WORDS = {3: "three", 4: "quarter", 60: "a minute"}

# -- help

DEFAULT = re.compile(r"\((\d[\w.,]*)\)\.?$")  # as the last that help says
DEFAULTS_ELSEWHERE = {"--dpi", "--text-size"}  # in the figure's own keys


def commands(command: click.Command, name: str) -> Iterator[tuple[str, click.Command]]:
    yield name, command
    if isinstance(command, click.Group):
        context = click.Context(command)
        for inner in command.list_commands(context):
            found = command.get_command(context, inner)
            assert found is not None
            yield from commands(found, f"{name} {inner}")


def test_defaults_of_options_are_those_that_help_states() -> None:
    programs = {"mapshade-server": mapshade_server, "splat-server": splat_server, "prepare": prepare_command}
    told, checked = dict(commands(volsplat, "volsplat")) | programs, 0
    for name, command in told.items():
        for option in command.params:
            if not isinstance(option, click.Option) or DEFAULTS_ELSEWHERE & set(option.opts):
                continue
            if stated := DEFAULT.search(option.help or ""):
                assert stated[1] == words(option.default), f"{name} {option.opts[0]}"
                checked += 1
    assert checked > 20, "help states defaults otherwise by now"


def words(value: object) -> str:
    match value:
        case bool():
            return str(value).lower()
        case int():
            return str(value)
        case float():
            return f"{value:g}"
    return str(value)


# -- the table of cluster files


def test_defaults_of_a_cluster_file_are_those_of_its_page() -> None:
    """A cell says the value itself; what stands for no value, as who chooses it then, is in words or empty."""
    stated = dict(rows(CLUSTER_FILE))
    for kind in (Cluster, Machine):
        for field in msgspec.structs.fields(kind):
            if isinstance(field.default, msgspec.Struct) or field.encode_name == "machines":
                continue  # they have tables of their own
            cell = stated.pop(field.encode_name)
            if field.required:
                assert cell == "required", field.encode_name
            elif field.default is None:
                assert not re.fullmatch(r"`.*`|[\d.]+|true|false|required", cell), field.encode_name
            else:
                assert cell.strip("`") == words(field.default), field.encode_name
    assert not stated, "the page has keys that no cluster file has"


def rows(page: Path) -> Iterator[tuple[str, str]]:
    """Each key of a page's tables, and the cell of its default."""
    for line in page.read_text(encoding="utf-8").splitlines():
        if line.startswith("| `"):
            keys, default, _ = (cell.strip() for cell in line.strip("|").split("|", 2))
            for key in keys.split(", "):
                yield key.strip("`"), default


# -- what is promised of losses and of strangers

PROMISES: list[tuple[Path, str, Any]] = [
    (RELIABILITY, "after {:g} seconds of silence (`--silence`)", SILENCE_SECONDS),
    (RELIABILITY, "says that it lives, for {:g} seconds at most", HELD * SILENCE_SECONDS),
    (RELIABILITY, "if its whole machine or network is gone, after {:g} seconds of silence", HELD * SILENCE_SECONDS),
    (RELIABILITY, "the others draw without it after {:g} seconds, with a line that says so |\n| one", PATIENCE_SECONDS),
    (RELIABILITY, "at most {} times", WORDS[MOST_RESTARTS]),
    (RELIABILITY, "times {}, and the frame is drawn", WORDS[int(RESTARTS_SECONDS)]),
    (RELIABILITY, "the client waits for {}.", WORDS[int(MISSING_SECONDS)]),
    (RELIABILITY, "the others draw without it after {:g} to", UNHEARD_SECONDS),
    (RELIABILITY, "to {:g} seconds, with a line that says why", UNHEARD_SECONDS + CONNECT_SECONDS),
    (RELIABILITY, "the others draw without it after {:g} seconds, with a line that says so; once", JOINING_SECONDS),
    (RELIABILITY, "It ends in any case after {:g} seconds", LEAVE_SECONDS),
    (RELIABILITY, "it ends after {:g} seconds of silence", LEAVING_SILENCE),
    (RELIABILITY, "else for a {} of the silence", WORDS[SIGNS_IN_SILENCE]),
    (CLUSTER_FILE, "and after {:g} those that run and do not dial", JOINING_SECONDS),
    (CLUSTER_FILE, "for which it waits, and gives up after {};", WORDS[int(TURN_SECONDS)]),
    (CLUSTER_FILE, "who waits for it gives up after {}.", WORDS[int(MISSING_SECONDS)]),
    (SECURITY, "It must be over within {:g} s", HANDSHAKE_SECONDS),
    (SECURITY, "dropped after {:g} s, however much has come", HANDSHAKE_SECONDS),
    (SECURITY, "may take {} KiB a message", LARGEST_GREETING >> 10),
    (SECURITY, "{} KiB of TLS", MOST_HANDSHAKE_BYTES >> 10),
    (SECURITY, "{} are greeted at a time", MOST_PENDING),
]


@pytest.mark.parametrize(("page", "promise", "number"), PROMISES)
def test_what_the_manual_promises_is_what_the_programs_go_by(page: Path, promise: str, number: Any) -> None:
    assert promise.format(number) in page.read_text(encoding="utf-8")
