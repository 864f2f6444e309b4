"""Phantoms: deterministic, of the size and spacing asked for, and with what they promise in them."""

import math
import resource
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

import tolerances
from support.checkout import ROOT
from volsplat.client.command.phantom_command import size_of_grid
from volsplat.client.phantoms import PHANTOMS, centred_grid, make_phantom, shells_tables, streamed_phantom
from volsplat.client.phantoms.known_signals import ramp, slab
from volsplat.client.phantoms.volume_writer import write_phantom, write_volume
from volsplat.client.session.single import SingleProcess
from volsplat.mapshade_server.readers import open_volume
from volsplat.protocol.description.scene import Image
from volsplat.protocol.description.volume import Box, Geometry, Index
from volsplat.protocol.text.errors import BadInput

NOISY = ("head", "shells", "galaxy", "seismic")


def head_at(values: torch.Tensor, x: float, y: float, z: float) -> int:
    """The head's CT value at a place in mm, on the default grid of 2 mm."""
    return int(values[round((z + 112) / 2), round((y + 127) / 2), round((x + 95) / 2)])


@pytest.mark.parametrize("name", PHANTOMS)
def test_a_phantom_is_the_same_each_time(name: str) -> None:
    first, second = (make_phantom(name, (24, 28, 20), seed=3)[0] for _ in range(2))
    assert torch.equal(first, second)
    other = make_phantom(name, (24, 28, 20), seed=4)[0]
    assert torch.equal(first, other) != (name in NOISY)


@settings(max_examples=4 * settings().max_examples)  # in all
@given(
    name=st.sampled_from(sorted(PHANTOMS)),
    size=st.tuples(st.integers(1, 30), st.integers(1, 30), st.integers(1, 30)),
    spacing=st.tuples(st.floats(0.1, 9), st.floats(0.1, 9), st.floats(0.1, 9)),
)
def test_size_and_spacing_are_those_asked_for(name: str, size: Index, spacing: tuple[float, float, float]) -> None:
    values, geometry = make_phantom(name, size, spacing)
    assert tuple(values.shape) == size[::-1] and geometry.dims == size
    assert values.dtype in (torch.uint8, torch.uint16, torch.float32)
    assert geometry.spacing == pytest.approx(spacing, rel=tolerances.GEOMETRY_FLOAT64)
    middle = geometry.physical(((size[0] - 1) / 2, (size[1] - 1) / 2, (size[2] - 1) / 2))
    assert middle == pytest.approx((0, 0, 0), abs=tolerances.ROUNDING)


# Not the head: its sines, rounded in vectors or at their tails, may move a value by one.
@pytest.mark.parametrize("name", sorted(PHANTOMS.keys() - {"head"}))
def test_a_phantom_does_not_depend_on_how_much_is_made_at_once(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    size = (20, 22, 18)
    whole = make_phantom(name, size)[0]
    monkeypatch.setattr(centred_grid, "VOXELS_AT_ONCE", 3 * size[0] * size[1])
    assert torch.equal(make_phantom(name, size)[0], whole)


@pytest.mark.parametrize("size", [(32, 32, 32), (64, 64, 64), (128, 128, 128), (96, 40, 150)])
def test_the_shells_show_10_to_15_percent_of_their_voxels(size: Index) -> None:
    opacity = torch.tensor(shells_tables().opac.entries())
    visible = (opacity[make_phantom("shells", size)[0].long()] > 0).double().mean().item()
    low, high = tolerances.SHELLS_VISIBLE
    assert low <= visible <= high


def test_large_shells_are_made_within_little_more_than_their_own_memory() -> None:
    make_phantom("shells", (8, 8, 8))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    values = make_phantom("shells", (256, 256, 256))[0]
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * (1 if sys.platform == "darwin" else 1024)
    assert grown < values.nbytes + 40 * centred_grid.VOXELS_AT_ONCE


def test_a_phantom_is_written_to_nrrd_within_less_than_its_own_memory(tmp_path: Path) -> None:
    size = (256, 256, 512)
    arguments = (str(tmp_path / "shells.nrrd"), str(math.prod(size) // 2), str(ROOT / "tests"))
    written = subprocess.run(
        [sys.executable, "-c", WRITE_WITH_LITTLE_MEMORY, *arguments], capture_output=True, encoding="utf-8"
    )
    assert written.returncode == 0, written.stderr
    reader = open_volume(str(tmp_path / "shells.nrrd"))
    few = reader.read(Box((0, 0, 254), (256, 256, 256)))
    assert reader.description.geometry.dims == size and few.max() > 100


WRITE_WITH_LITTLE_MEMORY = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[3])
from support.programs.little_memory import little_memory
from volsplat.client.phantoms import streamed_phantom
from volsplat.client.phantoms.volume_writer import write_phantom
for warming in streamed_phantom("shells", (256, 256, 1)).sheets:
    pass
made = streamed_phantom("shells", (256, 256, 512))
with little_memory(int(sys.argv[2])):
    write_phantom(Path(sys.argv[1]), made)
"""


def test_lengths_of_phantoms_have_their_unit_and_only_the_head_is_a_patient_s(tmp_path: Path) -> None:
    units = {"head": "mm", "rna": "Å", "protein": "Å", "p-orbital": "Å", "structure-factors": "1/Å"}
    for name in PHANTOMS:
        made = streamed_phantom(name, (8, 8, 8))
        values = make_phantom(name, (8, 8, 8))[0].numpy()
        for extension in (".nrrd", ".nhdr"):
            write_phantom(tmp_path / f"{name}{extension}", streamed_phantom(name, (8, 8, 8)))
            reader = open_volume(str(tmp_path / f"{name}{extension}"))
            told = reader.description
            assert (told.unit, told.anatomical) == (units.get(name, ""), name == "head"), name
            assert (told.kind, told.bands) == (made.kind, made.bands), name
            assert (reader.read(told.geometry.box) == values).all(), name


@pytest.mark.parametrize(("text", "size"), [("64", (64, 64, 64)), ("5x6x7", (5, 6, 7))])
def test_the_size_of_a_phantom_is_one_number_or_three(text: str, size: Index) -> None:
    assert size_of_grid(text) == size


def test_the_marschner_lobb_signal_is_its_formula() -> None:
    values, geometry = make_phantom("marschner-lobb")
    assert geometry.dims == (41, 41, 41)
    for index in ((0, 0, 0), (20, 20, 20), (3, 17, 29), (40, 1, 8)):
        x, y, z = geometry.physical((float(index[0]), float(index[1]), float(index[2])))
        ripple = math.cos(2 * math.pi * 6 * math.cos(math.pi * math.hypot(x, y) / 2))
        expected = (1 - math.sin(math.pi * z / 2) + 0.25 * (1 + ripple)) / (2 * 1.25)
        got = values[index[2], index[1], index[0]].item()
        assert got == pytest.approx(expected, abs=tolerances.SIGNAL_FLOAT32)


def test_the_ramp_rises_by_one_per_unit_along_its_direction() -> None:
    values, geometry = ramp((9, 8, 7), (0.5, 1.0, 2.0)).whole()
    for axis, per_step in ((2, 0.24), (1, 0.6), (0, 1.28)):
        steps = values.diff(dim=axis)
        torch.testing.assert_close(steps, torch.full_like(steps, per_step))


def test_the_slab_is_uniform_inside_its_margin() -> None:
    values, _ = slab((20, 16, 12)).whole()
    assert set(values.flatten().tolist()) == {0, 200}
    assert (values[4:-4, 4:-4, 4:-4] == 200).all()
    assert int((values == 200).sum()) == 12 * 8 * 4


@pytest.fixture(scope="module")
def head() -> tuple[torch.Tensor, Geometry]:
    return make_phantom("head")


def test_the_head_has_what_a_head_has_where_a_head_has_it(head: tuple[torch.Tensor, Geometry]) -> None:
    values, geometry = head
    assert geometry.dims == (96, 128, 113) and values.dtype == torch.uint16
    air, soft, bone = range(0, 101), range(900, 1150), range(1200, 2600)
    assert head_at(values, 0, -120, 0) in air
    assert head_at(values, 0, -103, -27) in soft  # the nose points to -y
    assert head_at(values, 0, 103, -27) in air
    assert head_at(values, 0, 12, 99) in bone  # the crown is at +z
    assert head_at(values, 0, 26, -108) in range(900, 2600)  # the neck at -z
    assert head_at(values, 29, -50, -26) in air  # maxillary sinus
    assert head_at(values, 31, -67, 2) in soft  # eye
    assert head_at(values, 0, -70, -82) in bone  # chin
    assert head_at(values, 0, -14, -50) in air  # throat
    ventricle, matter = head_at(values, 13, 4, 49), head_at(values, 30, 10, 55)
    assert ventricle in soft and ventricle < matter


def test_a_mirrored_head_is_another_head(head: tuple[torch.Tensor, Geometry]) -> None:
    values = head[0]
    bead = torch.tensor([74.0, 11.0, -37.0])  # in the left ear lobe, and patient left is +x
    assert head_at(values, *bead.tolist()) > 2600
    assert head_at(values, -bead[0].item(), bead[1].item(), bead[2].item()) < 1200
    assert head_at(values, 24, -72, 25) < 700 < head_at(values, -24, -72, 25)  # the left frontal sinus is larger


@pytest.mark.parametrize(
    ("name", "size", "spacing"),
    [
        ("torso", None, None),
        ("head", (0, 4, 4), None),
        ("shells", (1 << 12, 1 << 12, 1 << 12), None),
        ("slab", None, (1.0, 0.0, 1.0)),
        ("slab", None, (1.0, math.nan, 1.0)),
    ],
)
def test_a_phantom_that_cannot_be_is_refused(
    name: str, size: Index | None, spacing: tuple[float, float, float] | None
) -> None:
    with pytest.raises(BadInput) as refusal:
        make_phantom(name, size, spacing)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("size", [(1, 1, 1), (5, 1, 1), (1, 5, 1), (1, 1, 5), (5, 4, 1), (1, 4, 5)])
@pytest.mark.parametrize("extension", [".nrrd", ".mha", ".nii"])
def test_a_slab_of_one_voxel_row_or_slice_is_written_read_and_seen(
    extension: str, size: tuple[int, int, int], tmp_path: Path
) -> None:
    path = tmp_path / f"slab{extension}"
    write_volume(path, *make_phantom("slab", size=size))
    with SingleProcess(path) as single:
        assert single.volume.description.geometry.dims == size
        scene = msgspec.structs.replace(single.volume.default_scene(), image=Image(width=32, height=32))
        assert single.render(scene)[..., 3].max() > 0.25
