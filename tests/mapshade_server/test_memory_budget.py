"""A server tells what memory it lacks before it reads; what it reckons is what it then takes."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import nibabel
import numpy as np
import pytest
import SimpleITK as sitk
import torch

from support.patience import PATIENCE
from volsplat.client import Session
from volsplat.client.session.single import SingleProcess
from volsplat.mapshade_server.held.memory_budget import MemoryBudget, bytes_to_change, bytes_to_read
from volsplat.mapshade_server.held_volume import HeldVolume
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Image
from volsplat.protocol.description.shading_tables import ScalarTable
from volsplat.protocol.description.volume import Box, Geometry, VolumeDescription
from volsplat.protocol.messages import messages
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.tokens import new_token

SIDE = 160  # voxels
TOLERANCE = 0.25  # of what is reckoned: the C library keeps pages, and readers hold a block or two
PEAK = """
import sys
from volsplat.mapshade_server.held_volume import HeldVolume
from volsplat.mapshade_server.held.memory_budget import bytes_to_read
from volsplat.program.peak_memory import peak_memory
from volsplat.protocol.messages import messages
from volsplat.protocol.rules.index_rules import Quantisation

path, held = sys.argv[1], HeldVolume()
described = held.answers(messages.DescribeVolume(path=path))[0].message
before, box = peak_memory(), described.description.geometry.box
request = messages.ReadSubCubes(assignment=1, path=path, boxes=[box], identity=described.identity, held=True)
survey = held.answers(request)[0].message.survey
quantisation = Quantisation((survey.low, survey.high), survey.max_gradient)
held.answers(messages.PackVoxels(assignment=1, quantisation=quantisation))
print(bytes_to_read(described.description, [box]), peak_memory() - before)
"""

OF_SLABS = f"""
import numpy as np
import psutil
from volsplat.client.scene.presets import preset_scene
from volsplat.mapshade_server.frames.frame_walk import DEFAULT_PACKETS, DEFAULT_VOXELS, FrameWalk
from volsplat.mapshade_server.held.memory_budget import bytes_to_walk_slabs
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.levels import own_resolution

dims, quantisation = ({SIDE},) * 3, Quantisation((0.0, 255.0), 100.0)
geometry = Geometry(dims)
solid = SubCube.of_volume(geometry, np.random.default_rng(1).integers(100, 200, dims, "u1"))
solid.pack(quantisation)
drawing = Drawing.planned(preset_scene("ct-skin"), Step.G, geometry, quantisation, own_resolution(geometry, Step.G))
before = psutil.Process().memory_info().rss
(walker,) = FrameWalk([solid], drawing).walkers
while not walker.next_batch(DEFAULT_PACKETS, DEFAULT_VOXELS).last:
    pass
print(bytes_to_walk_slabs(geometry.box, geometry.box.voxels), psutil.Process().memory_info().rss - before)
"""


def stored(folder: Path, scalar_type: str, side: int = SIDE) -> Path:
    path = folder / f"{scalar_type}.npy"
    np.save(path, (np.random.default_rng(1).random((side, side, side)) * 100).astype(scalar_type))
    return path


@pytest.mark.parametrize("scalar_type", ["int16", "float32"])
def test_what_is_reckoned_is_what_is_taken(tmp_path: Path, scalar_type: str) -> None:
    check_reckoned(PEAK, str(stored(tmp_path, scalar_type)))


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz", ".nrrd"])
def test_what_is_reckoned_of_a_vector_is_what_is_taken(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"v{suffix}"
    vectors = np.zeros((SIDE, SIDE, SIDE, 3), np.float32)
    vectors[..., ::8, :] = np.random.default_rng(1).random((SIDE, SIDE, SIDE // 8, 3)) * 100
    sitk.WriteImage(sitk.GetImageFromArray(vectors, isVector=True), str(path))
    check_reckoned(PEAK, str(path))


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz"])
def test_what_is_reckoned_of_scaled_values_is_what_is_taken(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"v{suffix}"
    scaled = nibabel.Nifti1Image(np.load(stored(tmp_path, "int16")), np.eye(4))
    scaled.header.set_slope_inter(0.25, -3)
    nibabel.save(scaled, str(path))
    check_reckoned(PEAK, str(path))


def test_what_is_reckoned_for_step_g_is_what_it_keeps_of_a_solid() -> None:
    check_reckoned(OF_SLABS)


def check_reckoned(program: str, *arguments: str) -> None:
    command = [sys.executable, "-c", program, *arguments]
    told = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=True).stdout
    reckoned, taken = map(int, told.split())
    assert abs(taken - reckoned) < TOLERANCE * reckoned


@contextmanager
def opened(path: Path, limits: list[str]) -> Iterator[Session]:
    """A session whose map/shade servers may hold so much."""
    token = new_token()
    commands = [["splat_server"], *(["mapshade_server", "--memory", limit] for limit in limits)]
    servers: list[subprocess.Popen[bytes]] = []
    with Session(path, workers=len(limits), spawn=False, token=token) as session:
        for program, *options in commands:
            command = [sys.executable, "-m", f"volsplat.{program}", "--connect", str(session.address), *options]
            servers.append(subprocess.Popen(command, env={"VOLSPLAT_TOKEN": token.key.decode()}))
        yield session
    for server in servers:
        assert server.wait(PATIENCE) == 0


def test_a_server_without_room_says_so_before_it_reads_and_the_session_tells_it(tmp_path: Path) -> None:
    needed = r"no memory for the sub-cube: it needs 0\.4 MiB, but --memory leaves 0\.1 MiB; use more machines"
    with opened(stored(tmp_path, "int16", side=40), ["100K"]) as session, pytest.raises(BadInput, match=needed):
        session.default_scene()


def test_others_that_have_room_hold_what_one_has_no_room_for(tmp_path: Path) -> None:
    path = stored(tmp_path, "int16", side=40)
    with opened(path, ["1G", "10K", "1G"]) as session, SingleProcess(path) as single:
        scene = msgspec.structs.replace(session.default_scene(), image=Image(width=64, height=64))
        assert torch.equal(session.render(scene), single.render(scene))
        (lost,) = [server for server in session.servers if server.lost]
        assert "no memory for the sub-cube" in lost.cause and lost.cause.startswith("map/shade server")
        assert sum(server.voxels for server in session.servers if not server.lost) == 40**3


def test_step_g_is_refused_where_there_is_no_room_for_the_voxels_that_it_keeps(tmp_path: Path) -> None:
    """Before it is drawn; and the session goes on."""
    path = stored(tmp_path, "int16", side=40)
    with opened(path, ["500K"]) as session, SingleProcess(path) as single:
        scene = msgspec.structs.replace(session.default_scene(), image=Image(width=64, height=64))
        told = r"no memory for the voxels that step G keeps of the sub-cube: it needs 0\.3 MiB, but --memory leaves"
        for _ in range(2):
            with pytest.raises(BadInput, match=told):
                session.render(scene, Step.G)
            assert torch.equal(session.render(scene), single.render(scene))
    with opened(path, ["900K"]) as session, SingleProcess(path) as single:
        for _ in range(2):
            assert torch.equal(session.render(scene, Step.G), single.render(scene, Step.G))


def test_step_g_is_drawn_where_there_is_room_for_what_can_be_seen(tmp_path: Path) -> None:
    """Also if there is none for a solid; and tables that show more are asked about anew."""
    values, path = np.zeros((80, 80, 80), np.uint8), tmp_path / "small.npy"
    values[36:44, 36:44, 36:44] = 200
    np.save(path, values)
    with opened(path, ["4300K"]) as session, SingleProcess(path) as single:
        scene = msgspec.structs.replace(session.default_scene(), image=Image(width=64, height=64))
        assert torch.equal(session.render(scene, Step.G), single.render(scene, Step.G))
        opaque = ScalarTable(points=((0.0, 1.0), (1.0, 1.0)))
        solid = msgspec.structs.replace(scene, tables=msgspec.structs.replace(scene.tables, opac=opaque))
        with pytest.raises(BadInput, match="no memory for the voxels that step G keeps"):
            session.render(solid, Step.G)
        assert torch.equal(session.render(scene, Step.G), single.render(scene, Step.G))


def test_where_the_machine_has_too_little_left_nothing_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, held = str(stored(tmp_path, "int16", side=8)), HeldVolume()
    described = held.answers(messages.DescribeVolume(path=path))[0].message
    assert isinstance(described, messages.VolumeDescribed)
    box = described.description.geometry.box
    request = messages.ReadSubCubes(assignment=1, path=path, boxes=[box], identity=described.identity, held=True)
    monkeypatch.setattr("volsplat.mapshade_server.held.memory_budget.available_memory", lambda: 1000)
    with pytest.raises(BadInput, match="its machine has 0.0 MiB left"):
        held.answers(request)
    assert held.packed_bytes == 0


def test_what_stays_needs_no_more_and_what_is_copied_is_not_read() -> None:
    description = VolumeDescription(name="", format="", geometry=Geometry(dims=(8, 8, 8)), scalar_type="uint8")
    low, all_of_it = Box((0, 0, 0), (8, 8, 4)), Box((0, 0, 0), (8, 8, 8))
    assert bytes_to_change(description, [low], [low]) == 0
    assert bytes_to_change(description, [all_of_it], [low]) < 4 * 512 + bytes_to_read(description, [all_of_it])
    MemoryBudget(limit=1000).take(600, held=400, let_go=0)
    with pytest.raises(BadInput):
        MemoryBudget(limit=1000).take(601, held=400, let_go=0)
