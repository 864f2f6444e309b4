"""`volsplat view` where a container has less than a machine."""

import shutil
import signal
import subprocess
from pathlib import Path

import pytest

from support.files.head_volume import head
from support.patience import PATIENCE
from support.programs.programs import VOLSPLAT, Person

__all__ = ["head"]

APART = ("unshare", "--mount", "--propagation", "private", "sh", "-c")
READ_ONLY = "mount -t tmpfs -o ro none /dev/shm"


def test_the_page_is_served_where_dev_shm_cannot_be_written(head: Path, tmp_path: Path) -> None:
    if shutil.which("unshare") is None or subprocess.run([*APART, READ_ONLY], capture_output=True).returncode:
        pytest.skip("nothing can be mounted for one process here: this needs Linux and root")
    person = Person(tmp_path)
    command = [*APART, f'{READ_ONLY} && exec "$@"', "sh", str(VOLSPLAT), "view", str(head), "--no-browser"]
    with subprocess.Popen(command, env=person.environment, stderr=subprocess.PIPE, encoding="utf-8") as view:
        assert view.stderr is not None
        said = ""
        while "token=" not in said:
            line = view.stderr.readline()
            assert line, said
            said += line
        view.send_signal(signal.SIGINT)
        assert view.wait(PATIENCE) == 130
    assert not person.servers()
