"""`volsplat splat-server` as a program of its own."""

from volsplat.program.server_process import run_server

run_server("volsplat.splat_server.command", "splat_server", "splat-server")
