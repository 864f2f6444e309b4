"""`volsplat view` where a container has less than a machine."""

import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from support.files.head_volume import head
from support.patience import PATIENCE
from support.programs.programs import VOLSPLAT, Person

__all__ = ["head"]

APART = ("unshare", "--mount", "--propagation", "private", "sh", "-c")
SEEN_AT = Path("/mnt")
READ_ONLY = ("/dev/shm", "/tmp", "/var/tmp")


def test_the_page_is_served_where_neither_dev_shm_nor_any_temporary_folder_can_be_written(
    head: Path, tmp_path: Path
) -> None:
    mounts = [f"mount -t tmpfs -o ro none {folder}" for folder in READ_ONLY]
    barely = " && ".join([f"mount --bind '{head.parent}' {SEEN_AT}", *mounts, "cd /proc"])
    if shutil.which("unshare") is None or subprocess.run([*APART, barely], capture_output=True).returncode:
        pytest.skip("nothing can be mounted for one process here: this needs Linux and root")
    if any(VOLSPLAT.is_relative_to(folder) or Path(sys.prefix).is_relative_to(folder) for folder in READ_ONLY):
        pytest.skip("this needs volsplat itself outside of the temporary folders")
    person = Person(tmp_path)
    command = [*APART, f'{barely} && exec "$@"', "sh"]
    command += [str(VOLSPLAT), "view", str(SEEN_AT / head.name), "--no-browser"]
    with subprocess.Popen(
        command, env=person.environment | {"TMPDIR": "/tmp"}, stderr=subprocess.PIPE, encoding="utf-8"
    ) as view:
        assert view.stderr is not None
        said = ""
        while "token=" not in said:
            line = view.stderr.readline()
            assert line, said
            said += line
        view.send_signal(signal.SIGINT)
        assert view.wait(PATIENCE) == 130
    assert not person.servers()
