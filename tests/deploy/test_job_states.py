"""What the states of Slurm's jobs mean for servers."""

import pytest

from volsplat.deploy.launchers.launcher import ServerState, StartedServer
from volsplat.deploy.launchers.slurm import Job
from volsplat.deploy.launchers.slurm import _said as said


@pytest.mark.parametrize(
    ("word", "state"),
    [("COMPLETING", ServerState.QUEUED), ("RUNNING", ServerState.RUNNING), ("COMPLETED", ServerState.ENDED)],
)
def test_a_job_is_ended_only_once_slurm_will_not_run_it_again(word: str, state: ServerState) -> None:
    server = StartedServer("node splat", "job 1", {"job": "1", "log": "/nowhere"})
    assert said(server, Job(word, "node", "Resources")).state is state
