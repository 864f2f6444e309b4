"""`volsplat prepare` as a program of its own, with the machines of a cluster file at hand."""

from volsplat.deploy.batch.task_pools import opened_pool
from volsplat.program.server_process import run_server

run_server("volsplat.mapshade_server.prepare.command", "prepare_command", "volsplat", opened_pool)
