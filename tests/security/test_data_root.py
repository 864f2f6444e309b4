"""A map/shade server with --data-root, as a process of its own: nothing outside is read, whatever leads there."""

import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pytest
import tifffile
from security.landlock import WITHOUT, has_landlock

from support.patience import PATIENCE
from volsplat.deploy.server_command import Program, server_command
from volsplat.mapshade_server.readers.reading.data_root import DataRoot
from volsplat.protocol.description.volume_name import LONGEST_VOLUME_NAME, MOST_SIGNS
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import BadInput
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
    (inside / "x:").mkdir()
    np.save(inside / "x:" / "own.npy", VOXELS)
    np.save(outside / "secret.npy", VOXELS)
    (outside / "secret.raw").write_bytes(VOXELS.tobytes())
    with h5py.File(outside / "secret.h5", "w") as file:
        file["v"] = VOXELS
    with h5py.File(inside / "external.h5", "w") as file:
        file["v"] = h5py.ExternalLink(str(outside / "secret.h5"), "/v")
    (inside / "up.nhdr").write_text(NRRD.format(f"../{outside.name}/secret.raw"), encoding="ascii")
    (inside / "absolute.mhd").write_text(META_IMAGE.format(f"{outside}/secret.raw"), encoding="ascii")
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


@pytest.mark.parametrize("folder", ["/no/volumes", "~no-one/volumes"])
def test_a_root_that_is_not_there_is_named(folder: str) -> None:
    with pytest.raises(BadInput, match=f"^--data-root {folder}: .*; name a folder of this machine$"):
        DataRoot(Path(folder))


@pytest.mark.parametrize("begin", ["#", "/#", "x/../#", "x#/../"])
def test_no_name_has_more_places_looked_at_than_a_few(root: Path, begin: str, monkeypatch: pytest.MonkeyPatch) -> None:
    held, looked = DataRoot(root), list[Path]()
    resolve = Path.resolve

    def counted(path: Path) -> Path:
        looked.append(path)
        return resolve(path)

    monkeypatch.setattr(Path, "resolve", counted)
    for count in (MOST_SIGNS, MOST_SIGNS + 1, (LONGEST_VOLUME_NAME - len(str(root)) - 1) // len(begin)):
        looked.clear()
        with suppress(BadInput):
            held.check(f"{root}/{begin * count}")
        assert len(looked) <= MOST_SIGNS + 1


def described(control: Connection, name: str | Path) -> messages.Message:
    control.send(messages.DescribeVolume(str(name)))
    received = control.receive()
    assert received is not None
    return received.message


def test_what_lies_below_it_is_read_by_either_name_and_nothing_else(control: Connection, root: Path) -> None:
    outside = root.parent / "root of others"
    for name in (root / "own.npy", "own.npy", f"file://{root}/own.npy", f"file://{root}/x:%2F%2Fown.npy"):
        assert isinstance(described(control, name), messages.VolumeDescribed)
    headers = ("up.nhdr", "absolute.mhd", "external.h5", "external.h5#/v")
    links = ("link.npy", "folder/secret.npy", "folder", "linked.zarr", f"../{outside.name}/secret.npy", "..")
    others = (outside / "secret.npy", "/etc/passwd", "/proc/self/environ", "https://example.org/v.zarr", "~")
    disguised = (f"file://{outside}%2Fsecret.npy", "file://https://example.org/v.zarr", "own.npy\0")
    for name in (*headers, *links, *others, *disguised):
        refused = described(control, name)
        assert isinstance(refused, messages.Refused), name
        assert "VOLSPLAT_TOKEN" not in refused.cause
    own = described(control, "own.npy")
    assert isinstance(own, messages.VolumeDescribed)
    for name, told in (("own.npy", messages.VoxelRead), (str(outside / "secret.npy"), messages.Refused)):
        control.send(messages.ReadVoxel(1, name, own.identity, (0, 0, 0)))
        received = control.receive()
        assert received is not None and isinstance(received.message, told)


def test_a_refusal_does_not_tell_whether_there_is_such_a_file(control: Connection, root: Path) -> None:
    there, nowhere = root.parent / "root of others" / "secret.npy", root.parent / "root of others" / "absent.npy"
    causes = []
    for name in (there, nowhere):
        refused = described(control, name)
        assert isinstance(refused, messages.Refused)
        causes.append(refused.cause.replace(str(name), "NAME"))
    assert causes[0] == causes[1]


def test_where_a_name_is_split_does_not_tell_whether_there_is_such_a_file(control: Connection, root: Path) -> None:
    (root / "own#1").mkdir()
    for part in ("", "#1"):
        causes = []
        for name in ("secret.npy", "absent.npy"):
            refused = described(control, f"own#1/../../root of others/{name}{part}")
            assert isinstance(refused, messages.Refused)
            causes.append(refused.cause.replace(name, "NAME"))
        assert causes[0] == causes[1]


NRRD = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 8 8 8\nspacings: 1 1 1\nencoding: raw\ndata file: {}\n"
META_IMAGE = "ObjectType = Image\nNDims = 3\nDimSize = 8 8 8\nElementType = MET_UCHAR\nElementDataFile = {}\n"


def linked(path: Path, place: str) -> None:
    with h5py.File(path, "w") as file:
        file["v"] = h5py.ExternalLink(place, "/v")


def linked_twice(path: Path, place: str) -> None:
    between = path.with_name(f"between {path.name}")
    linked(between, place)
    linked(path, between.name)


def virtual(path: Path, place: str) -> None:
    layout = h5py.VirtualLayout(VOXELS.shape, np.uint8)
    layout[:] = h5py.VirtualSource(place, "v", VOXELS.shape)
    with h5py.File(path, "w") as file:
        file.create_virtual_dataset("v", layout)


def kept_elsewhere(path: Path, place: str) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("v", VOXELS.shape, np.uint8, external=[(place, 0, VOXELS.nbytes)])


def ome_tiff(path: Path, place: str) -> None:
    """Its voxels are said to lie in another file."""
    told = (
        '<OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"><Image ID="Image:0"><Pixels ID="Pixels:0" '
        'DimensionOrder="XYZCT" Type="uint8" SizeX="8" SizeY="8" SizeZ="8" SizeC="1" SizeT="1"><TiffData FirstZ="0" '
        f'PlaneCount="8"><UUID FileName="{place}">urn:uuid:0</UUID></TiffData></Pixels></Image></OME>'
    )
    tifffile.imwrite(path, VOXELS, description=told, metadata=None)


NAMING: dict[str, Callable[[Path, str], object]] = {
    "one.nhdr": lambda path, place: path.write_text(NRRD.format(place), encoding="ascii"),
    "one.mhd": lambda path, place: path.write_text(META_IMAGE.format(place), encoding="ascii"),
    "linked.h5": linked,
    "linked_twice.h5": linked_twice,
    "virtual.h5": virtual,
    "kept_elsewhere.h5": kept_elsewhere,
    "one.ome.tif": ome_tiff,
}


def test_a_header_does_not_tell_whether_there_is_what_it_names(control: Connection, root: Path) -> None:
    outside = Path("..", "root of others")
    (root / outside / "short.raw").write_bytes(b"short")
    for name, make in NAMING.items():
        causes = set()
        for place in ("secret.h5", "secret.raw", "short.raw", "absent.raw", "absent/absent.raw", "/etc/passwd"):
            make(root / name, str(outside / place))
            for part in ("", "#/v") if name.endswith(".h5") else ("",):
                refused = described(control, f"{name}{part}")
                assert isinstance(refused, messages.Refused)
                causes.add(refused.cause.replace(str(outside / place), "PLACE"))
        (cause,) = causes
        assert "names PLACE, which does not lie below this server's --data-root" in cause


def test_what_a_header_names_within_is_read(control: Connection, root: Path) -> None:
    (root / "voxels.raw").write_bytes(VOXELS.tobytes())
    shutil.copy(root.parent / "root of others" / "secret.h5", root / "voxels.h5")
    tifffile.imwrite(root / "voxels.tif", VOXELS, metadata=None)
    of_its_own = {"kept_elsewhere.h5": "voxels.raw", "one.ome.tif": "voxels.tif"}
    for name, make in NAMING.items():
        make(root / name, of_its_own.get(name, "voxels.h5" if name.endswith(".h5") else "voxels.raw"))
        answer = described(control, f"{name}#/v" if name.endswith(".h5") else name)
        assert isinstance(answer, messages.VolumeDescribed), name
        assert answer.description.geometry.dims == VOXELS.shape


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


def test_the_scratch_folder_of_a_killed_server_ends_with_the_next_one_s(root: Path, tmp_path: Path) -> None:
    scratch, token = tmp_path / "scratch", new_token()
    scratch.mkdir()
    left = set[Path]()
    with Listener(Role.CLIENT, token) as clients:
        command = server_command(Program.MAPSHADE_SERVER, "--connect", str(clients.address), "--data-root", str(root))
        for _ in range(2):
            with subprocess.Popen(command, env=token.added_to(os.environ | {"TMPDIR": str(scratch)})) as server:
                connection = clients.accept(PATIENCE)
                assert connection is not None
                folders = set(scratch.iterdir())
                assert len(folders) == 1 and not folders & left
                left = folders
                server.kill()
                connection.close()


IMPORTS_LATER = """
import sys
from pathlib import Path
from volsplat.program.confinement import confine_reading
root, *secrets = map(Path, sys.argv[1:])
confine_reading([root])
import filters
for secret in secrets:
    try:
        secret.read_text()
    except PermissionError:
        continue
    sys.exit(f"{secret} was read")
"""


def check_nothing_but_filters_is_read(place: Path, pythonpath: list[str], begin: str = "") -> None:
    """Below a place whose `libraries` hold filters.py."""
    folders = [place / name for name in ("root", "home", "begun", "beside")]
    secrets = [folder / "secret.txt" for folder in folders[1:]] + [place / "secret.txt"]
    for folder in (*folders, place / "libraries"):
        folder.mkdir()
    for file in (*secrets, place / "libraries" / "filters.py"):
        file.touch()
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(pythonpath), "HOME": str(place / "home")}
    command = [sys.executable, "-c", begin + IMPORTS_LATER, str(place / "root"), *map(str, secrets)]
    done = subprocess.run(command, cwd=place / "begun", env=environment, capture_output=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr.decode()


@pytest.mark.parametrize("holding", [".", "root", "home", "begun"])
@pytest.mark.parametrize("libraries", ["../libraries", "{place}/libraries"])
def test_libraries_that_pythonpath_names_are_found_and_what_holds_root_home_or_the_command_stays_closed(
    tmp_path: Path, holding: str, libraries: str
) -> None:
    """Environment modules of a cluster set it; Python itself adds the folder of the command."""
    named = [libraries.format(place=tmp_path), str(tmp_path / holding), ""]
    check_nothing_but_filters_is_read(tmp_path, named)


def test_the_folder_beside_an_editable_install_stays_closed(tmp_path: Path) -> None:
    """What a .pth file names is on the path like any other folder, and holds the checkout's neighbours."""
    adds = f"import site; site.addsitedir({str(tmp_path / 'site')!r})\n"
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "editable.pth").write_text(f"{tmp_path}\n")
    check_nothing_but_filters_is_read(tmp_path, [str(tmp_path / "libraries")], adds)
