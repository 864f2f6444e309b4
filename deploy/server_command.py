"""The command line that starts a server, the same for every launcher."""

import re
import sys
from enum import Enum

from volsplat.protocol.text.errors import BadInput

_WORD = re.compile(r"""(?:[^\s\\'"]|\\.|'[^']*'|"(?:[^"\\]|\\.)*")+""")


class Program(Enum):
    """Which server, by the name of its module."""

    MAPSHADE_SERVER = "volsplat.mapshade_server"
    SPLAT_SERVER = "volsplat.splat_server"

    @property
    def title(self) -> str:
        """The name that a person knows it by."""
        return {Program.MAPSHADE_SERVER: "map/shade server", Program.SPLAT_SERVER: "splat server"}[self]

    @property
    def command(self) -> str:
        """The sub-command of `volsplat` that becomes it."""
        return {Program.MAPSHADE_SERVER: "mapshade-server", Program.SPLAT_SERVER: "splat-server"}[self]


def server_command(program: Program, *options: str, python: str = sys.executable) -> list[str]:
    """The command that runs `program`. The token never stands on it: it goes through the environment."""
    return [python, "-m", program.value, *options]


def first_word(command: str) -> str:
    """What a shell would run, quoted as it stands there: a `~` without quotes is a home. Raises BadInput."""
    word = _WORD.match(command.strip())
    if word is None or not re.match(r"\s|$", command.strip()[word.end() :]):
        raise BadInput(f"{command!r} cannot be called: a shell finds no word, or no end of one; check its quotes")
    return word[0]
