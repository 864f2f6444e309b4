"""One client at a time uses a cluster: who waits hears for whom, and nobody takes another for itself."""

import fcntl
import gc
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import msgspec
import pytest

from volsplat.deploy.cluster.cluster_use import ClusterUse, Holder
from volsplat.deploy.cluster.state import StateFolder
from volsplat.protocol.text.errors import BadInput


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> StateFolder:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return StateFolder("lab")


@contextmanager
def held(folder: StateFolder, told: bytes) -> Iterator[BinaryIO]:
    """As by another client, which tells of itself so."""
    with os.fdopen(folder.opened("client"), "r+b", buffering=0) as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.write(told)
        yield file


@pytest.mark.parametrize(
    ("told", "who"),
    [
        (b"", "another client"),
        (b"{", "another client"),
        (msgspec.json.encode(Holder.this_process()), rf".* \(process {os.getpid()}, since .*\)"),
    ],
    ids=["empty", "torn", "alike"],
)
def test_who_waits_hears_of_it_though_the_other_cannot_be_named_or_is_called_alike(
    folder: StateFolder, told: bytes, who: str
) -> None:
    """In two containers processes may have the same number, and machines the same name."""
    said: list[str] = []
    use = ClusterUse(folder)
    with held(folder, told) as file:

        def hear(line: str) -> None:
            said.append(line)
            file.close()

        use.take(hear)
    use.end()
    (line,) = said
    assert re.fullmatch(f"waiting for {who}, which the cluster lab serves", line)


@pytest.mark.filterwarnings(
    "ignore:Exception ignored:pytest.PytestUnraisableExceptionWarning", "ignore::ResourceWarning"
)
def test_a_process_is_told_of_its_own_use_until_that_ends_or_is_forgotten(folder: StateFolder) -> None:
    heard: list[str] = []
    for ends in (True, False):
        use = ClusterUse(folder)
        use.take(heard.append)
        with pytest.raises(BadInput, match="this process uses the cluster lab already, since .*; close that first"):
            ClusterUse(folder).take(heard.append)
        if ends:
            use.end()
        del use
        gc.collect()
    with held(folder, b""), pytest.MonkeyPatch.context() as patch:
        patch.setattr("volsplat.deploy.cluster.cluster_use.PATIENCE_SECONDS", 0.0)
        with pytest.raises(BadInput, match="the cluster lab serves .*; end that one"):
            ClusterUse(folder).take(heard.append)
    assert len(heard) <= 1


def test_who_has_ended_is_not_named_to_the_next(folder: StateFolder) -> None:
    use = ClusterUse(folder)
    use.take(print)
    assert msgspec.json.decode((folder.path / "client").read_bytes(), type=Holder).process == os.getpid()
    use.end()
    use.end()
    assert (folder.path / "client").read_bytes() == b""
