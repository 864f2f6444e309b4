"""The command line that starts a server, the same for every launcher."""

import sys
from enum import Enum


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
