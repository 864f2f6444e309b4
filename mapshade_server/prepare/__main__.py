"""`volsplat prepare` as a program of its own."""

from volsplat.mapshade_server.prepare.command import prepare_command
from volsplat.protocol.server_process import run_server

run_server(prepare_command, "volsplat")
