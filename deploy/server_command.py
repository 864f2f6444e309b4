"""The command line that starts a server or another program of its side, the same for every launcher."""

import sys
from enum import Enum


class Program(Enum):
    """What can be started, by the name of its module."""

    MAPSHADE_SERVER = "volsplat.mapshade_server"
    SPLAT_SERVER = "volsplat.splat_server"
    PREPARE = "volsplat.mapshade_server.prepare"  # where the data is, but no server

    @property
    def title(self) -> str:
        """The name that a person knows it by."""
        return {
            "MAPSHADE_SERVER": "map/shade server",
            "SPLAT_SERVER": "splat server",
            "PREPARE": "preparation",
        }[self.name]


def server_command(program: Program, *options: str, python: str = sys.executable) -> list[str]:
    """The command that runs `program`. The token never stands on it: it goes through the environment."""
    return [python, "-m", program.value, *options]
