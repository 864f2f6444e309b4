"""A map/shade server with --data-root, as a process of its own: nothing outside is read, whatever leads there."""

import os
import subprocess
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import h5py
import numpy as np
import pytest
from security.landlock import WITHOUT, has_landlock

from support.patience import PATIENCE
from volsplat.deploy.server_command import Program, server_command
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.listener import Listener
from volsplat.protocol.wire.tokens import new_token

VOXELS = np.arange(8 * 8 * 8, dtype=np.uint8).reshape(8, 8, 8)

pytestmark = pytest.mark.skipif(not has_landlock(), reason=WITHOUT)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A folder with a volume, and beside it another that holds a secret."""
    inside, outside = tmp_path / "root", tmp_path / "root of others"
    inside.mkdir()
    outside.mkdir()
    np.save(inside / "own.npy", VOXELS)
    np.save(outside / "secret.npy", VOXELS)
    (outside / "secret.raw").write_bytes(VOXELS.tobytes())
    with h5py.File(outside / "secret.h5", "w") as file:
        file["v"] = VOXELS
    with h5py.File(inside / "external.h5", "w") as file:
        file["v"] = h5py.ExternalLink(str(outside / "secret.h5"), "/v")
    nrrd = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 8 8 8\nspacings: 1 1 1\nencoding: raw\ndata file: "
    (inside / "up.nhdr").write_text(f"{nrrd}../{outside.name}/secret.raw\n", encoding="ascii")
    image = "ObjectType = Image\nNDims = 3\nDimSize = 8 8 8\nElementType = MET_UCHAR\nElementDataFile = "
    (inside / "absolute.mhd").write_text(f"{image}{outside}/secret.raw\n", encoding="ascii")
    (inside / "link.npy").symlink_to(outside / "secret.npy")
    (inside / "folder").symlink_to(outside)
    zarr = inside / "linked.zarr"
    zarr.symlink_to(outside / "secret.zarr")
    return inside


@pytest.fixture
def control(root: Path) -> Iterator[Connection]:
    """The client's link to a server that is held to that folder."""
    token = new_token()
    with Listener(Role.CLIENT, token) as clients:
        command = server_command(Program.MAPSHADE_SERVER, "--connect", str(clients.address), "--data-root", str(root))
        with subprocess.Popen(command, env=token.added_to(os.environ)) as server:
            connection = clients.accept(PATIENCE)
            assert connection is not None
            with connection:
                yield connection
                connection.send(messages.EndSession())
            assert server.wait(PATIENCE) == 0


def described(control: Connection, name: str | Path) -> messages.Message:
    control.send(messages.DescribeVolume(str(name)))
    received = control.receive()
    assert received is not None
    return received.message


def test_what_lies_below_it_is_read_by_either_name_and_nothing_else(control: Connection, root: Path) -> None:
    outside = root.parent / "root of others"
    for name in (root / "own.npy", "own.npy", f"file://{root}/own.npy"):
        assert isinstance(described(control, name), messages.VolumeDescribed)
    headers = ("up.nhdr", "absolute.mhd", "external.h5", "external.h5#/v")
    links = ("link.npy", "folder/secret.npy", "folder", "linked.zarr", f"../{outside.name}/secret.npy", "..")
    others = (outside / "secret.npy", "/etc/passwd", "/proc/self/environ", "https://example.org/v.zarr", "~")
    for name in (*headers, *links, *others):
        refused = described(control, name)
        assert isinstance(refused, messages.Refused), name
        assert "VOLSPLAT_TOKEN" not in refused.cause
    assert isinstance(described(control, "own.npy"), messages.VolumeDescribed)


def test_a_refusal_does_not_tell_whether_there_is_such_a_file(control: Connection, root: Path) -> None:
    there, nowhere = root.parent / "root of others" / "secret.npy", root.parent / "root of others" / "absent.npy"
    causes = []
    for name in (there, nowhere):
        refused = described(control, name)
        assert isinstance(refused, messages.Refused)
        causes.append(refused.cause.replace(str(name), "NAME"))
    assert causes[0] == causes[1]


def test_a_link_that_is_swapped_all_the_time_leads_nowhere_else(control: Connection, root: Path) -> None:
    """Between the check of a name and its opening it may point elsewhere."""
    np.save(root.parent / "root of others" / "longer.npy", np.concatenate([VOXELS, VOXELS]))
    swapped, spare = root / "swapped.npy", root / "spare.npy"
    done = threading.Event()

    def swap() -> None:
        while not done.is_set():
            for target in (root.parent / "root of others" / "longer.npy", root / "own.npy"):
                spare.symlink_to(target)
                spare.replace(swapped)

    with ThreadPoolExecutor(1) as thread:
        swapping = thread.submit(swap)
        try:
            answers = [described(control, swapped) for _ in range(200)]
        finally:
            done.set()
        swapping.result(PATIENCE)
    for answer in answers:
        assert not isinstance(answer, messages.VolumeDescribed) or answer.description.geometry.dims == VOXELS.shape
