"""The command line that starts a server, the same for every launcher."""

import sys
from enum import StrEnum


class Program(StrEnum):
    """The servers that can be started, by the name of their module."""

    MAPSHADE_SERVER = "volsplat.mapshade_server"
    SPLAT_SERVER = "volsplat.splat_server"


def server_command(program: Program, *options: str, python: str = sys.executable) -> list[str]:
    """The command that runs `program`. The token never stands on it: it goes through the environment."""
    return [python, "-m", program.value, *options]
