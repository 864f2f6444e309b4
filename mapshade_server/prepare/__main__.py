"""`volsplat prepare` as a program of its own."""

from volsplat.program.server_process import run_server

run_server("volsplat.mapshade_server.prepare.command", "prepare_command", "volsplat")
