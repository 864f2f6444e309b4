"""Gaussian cube files: benzene's orbital as its own text has it, and files made here for what it has not."""

import gzip
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import tolerances
from support.files.opened import read_whole
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.molecules.gaussian_cube import ANGSTROM_PER_BOHR, CHUNK_BYTES
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import BadInput

SKEWED = ((0.3, 0.02, 0.0), (0.1, 0.4, -0.05), (0.0, 0.15, 0.25))  # the steps of the three axes
ORIGIN = (-1.0, 2.0, -3.5)
SHAPE = (4, 5, 6)  # x, y, z as the file counts them


def values_of(count: int = 1, shape: tuple[int, int, int] = SHAPE) -> Voxels:
    """Signed values shaped (x, y, z, value), all different, with the six digits that the text keeps."""
    total = int(np.prod(shape)) * count
    return np.linspace(-2.0, 3.0, total).round(5).reshape(*shape, count)


def cube_text(
    values: Voxels,
    atoms: int = 2,
    head: str | None = None,
    orbitals: Sequence[int] = (),
    steps: Sequence[Sequence[float]] = SKEWED,
    angstrom: bool = False,
) -> str:
    """As Gaussian prints it: six numbers a line, a new line for each (x, y)."""
    sign = -1 if angstrom else 1
    lines = [" a title", " MO coefficients" if atoms < 0 else " density"]
    lines.append(head or f"{atoms:5d} {ORIGIN[0]:11.6f} {ORIGIN[1]:11.6f} {ORIGIN[2]:11.6f}")
    for count, step in zip(values.shape, steps, strict=False):
        lines.append(f"{sign * count:5d}" + "".join(f"{x:12.6f}" for x in step))
    lines += [f"    6    6.000000{n:12.6f}    0.000000    0.000000" for n in range(abs(atoms))]
    listed = [len(orbitals), *orbitals] if orbitals else []
    lines += ["".join(f"{number:5d}" for number in listed[n : n + 10]) for n in range(0, len(listed), 10)]
    for row in values.reshape(values.shape[0] * values.shape[1], -1):
        lines += ["".join(f" {x:12.5E}" for x in row[n : n + 6]) for n in range(0, len(row), 6)]
    return "\n".join(lines) + "\n"


def written(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def assert_same(got: Voxels, values: Voxels) -> None:
    assert got.dtype == np.float32 and got.flags.c_contiguous
    np.testing.assert_array_equal(got, values.transpose(2, 1, 0).astype(np.float32))


def test_the_benzene_orbital_has_the_numbers_of_its_text(shared_data: Path) -> None:
    path = shared_data / "orbital" / "benzene-homo.cube"
    description = open_volume(str(path)).description
    assert description.geometry.dims == (55, 55, 40)
    assert description.unit == "Å" and description.density_name == "wave function"
    assert not description.reads_sub_cubes and description.why_whole
    step = 0.333333 * ANGSTROM_PER_BOHR
    assert description.geometry.spacing == pytest.approx((step, step, step), rel=tolerances.GEOMETRY_FLOAT64)
    corner = [x * ANGSTROM_PER_BOHR for x in (-9.021977, -9.069442, -6.512782)]
    assert description.geometry.origin == pytest.approx(corner, rel=tolerances.GEOMETRY_FLOAT64)
    header_lines = 2 + 4 + 12 + 1
    words = " ".join(path.read_text(encoding="utf-8").splitlines()[header_lines:]).split()
    assert_same(read_whole(str(path)), np.array(words, np.float64).reshape(55, 55, 40))


def test_the_benzene_orbital_changes_its_sign_in_the_plane_of_the_ring(shared_data: Path) -> None:
    path = str(shared_data / "orbital" / "benzene-homo.cube")
    voxels = read_whole(path)
    assert (voxels.min(), voxels.max()) == pytest.approx((-0.2125, 0.2125), rel=tolerances.RANGE_PRINTED)
    heights = [open_volume(path).description.geometry.physical((0.0, 0.0, float(k)))[2] for k in range(40)]
    k, j, i = np.unravel_index(voxels.argmax(), voxels.shape)
    assert abs(heights[k]) < 1  # a pi orbital is greatest half an Angstrom above and below the ring
    other = min(range(40), key=lambda n: abs(heights[n] + heights[k]))
    assert voxels[other, j, i] == pytest.approx(-voxels[k, j, i], rel=0.1)


def test_orbital_21_may_be_named(shared_data: Path) -> None:
    path = shared_data / "orbital" / "benzene-homo.cube"
    np.testing.assert_array_equal(read_whole(f"{path}#21"), read_whole(str(path)))


def test_a_skewed_cell_and_its_lengths_in_angstrom(tmp_path: Path) -> None:
    values = values_of()[..., 0]
    for angstrom, factor in ((False, ANGSTROM_PER_BOHR), (True, 1.0)):
        path = written(tmp_path / "volume.cube", cube_text(values, angstrom=angstrom))
        geometry = open_volume(str(path)).description.geometry
        assert geometry.dims == SHAPE
        expected = factor * np.array(SKEWED).T
        np.testing.assert_allclose(geometry.index_to_physical, expected, rtol=tolerances.GEOMETRY_FLOAT64)
        np.testing.assert_allclose(geometry.origin, factor * np.array(ORIGIN), rtol=tolerances.GEOMETRY_FLOAT64)
        assert_same(read_whole(str(path)), values)


def test_boxes_are_slices_of_the_whole(tmp_path: Path) -> None:
    values = values_of()[..., 0]
    reader = open_volume(str(written(tmp_path / "volume.cube", cube_text(values))))
    assert_same(reader.read(Box((1, 2, 3), (4, 4, 6))), values[1:4, 2:4, 3:6])


def test_one_of_several_orbitals_is_chosen_by_its_number(tmp_path: Path) -> None:
    orbitals = list(range(15, 27))  # a list of two lines
    values = values_of(len(orbitals))
    path = written(tmp_path / "volume.cube", cube_text(values, atoms=-2, orbitals=orbitals))
    for n in (0, 5, 11):
        assert_same(read_whole(f"{path}#{orbitals[n]}"), values[..., n])
    assert open_volume(f"{path}#17").description.density_name == "wave function 17"
    with pytest.raises(BadInput, match=r"12 orbitals: 15, 16, .*, 26; choose one, as in volume.cube#15"):
        open_volume(str(path))
    with pytest.raises(BadInput, match="no part “3”; its orbitals are 15"):
        open_volume(f"{path}#3")


def test_values_beside_each_other_without_orbitals_are_counted(tmp_path: Path) -> None:
    values = values_of(4)  # a density and its gradient
    head = f"    2 {ORIGIN[0]} {ORIGIN[1]} {ORIGIN[2]}    4"
    path = written(tmp_path / "volume.cube", cube_text(values, head=head))
    assert_same(read_whole(f"{path}#3"), values[..., 2])
    with pytest.raises(BadInput, match=r"4 values a voxel: 1, 2, 3, 4; choose one"):
        open_volume(str(path))


def test_a_file_of_several_chunks(tmp_path: Path) -> None:
    values = values_of(3, (30, 40, 50))
    text = cube_text(values, atoms=-1, orbitals=[7, 8, 9])
    assert len(text) > 2 * CHUNK_BYTES
    path = written(tmp_path / "volume.cube", text)
    assert_same(read_whole(f"{path}#8"), values[..., 1])


def test_fortran_exponents_and_other_line_ends(tmp_path: Path) -> None:
    values = np.array([1e-5, -2.5e-100, 3e2, -4.0, 5.5e-7, np.inf, 7, 8], np.float64).reshape(2, 2, 2)
    text = cube_text(np.zeros((2, 2, 2)), steps=np.eye(3).tolist())
    head = "\r\n".join(text.splitlines()[:8])
    path = written(tmp_path / "volume.cube", head + "\r\n1.0D-05 -2.5-100 3.0d+02\t-4\r\n.55E-06 6+300 7. 8")
    assert_same(read_whole(str(path)), values)


def test_gzip_is_unpacked(tmp_path: Path) -> None:
    values = values_of()[..., 0]
    path = tmp_path / "volume.cube.gz"
    path.write_bytes(gzip.compress(cube_text(values).encode()))
    assert_same(read_whole(str(path)), values)


def edited(line: int, new: str) -> str:
    lines = cube_text(values_of()[..., 0]).splitlines()
    lines[line] = new
    return "\n".join(lines) + "\n"


REFUSALS = {
    "a table of colours": ("TITLE x\nLUT_3D_SIZE 2\n0 0 0\n1 0 0\n", "no number of atoms and origin"),
    "a cut header": (cube_text(values_of()[..., 0])[:90], "no number of voxels and step of an axis"),
    "cut among the atoms": (cube_text(values_of()[..., 0])[:230], "no atom where"),
    "no orbitals listed": (cube_text(values_of()[..., 0], atoms=-2), "values a voxel by its header"),
    "orbitals beyond their count": (
        cube_text(values_of(2), atoms=-2, orbitals=[1, 2]).replace("    2    1", "    1    1"),
        "more orbitals than the 1",
    ),
    "atoms in part": (edited(2, "  2.5 0 0 0"), "no whole numbers"),
    "no voxels": (edited(3, "  0 0.3 0 0"), "no whole numbers"),
    "two units": (edited(3, " -4 0.3 0 0"), "in bohr"),
    "a plane": (cube_text(values_of(1, (4, 5, 1))[..., 0]), "a 2-D image, volsplat needs a volume"),
    "a lying size": (edited(3, "  4000000 0.3 0 0"), "promises 120000000 numbers, but the file holds only"),
    "no step": (edited(4, "  5 0 0 0"), "do not span space"),
    "a step that is no number": (edited(4, "  5 nan 0 0"), "of a size that float64 can compute with"),
    "an origin that is no number": (edited(2, "  2 nan 0 0"), "origin is not finite"),
    "words among the voxels": (edited(9, "  1.0 2.0 three 4.0 5.0 6.0"), "has b'three' where a voxel should be"),
    "truncated": (cube_text(values_of()[..., 0])[:-40], "is truncated, it ends after 117 of its 120 numbers"),
    "too much": (cube_text(values_of()[..., 0]) + "1.0\n", "holds more numbers than the 120"),
    "one long word": (cube_text(values_of()[..., 0])[:-40] + "1" * 3 * CHUNK_BYTES, "is truncated"),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_bad_files_are_refused_in_one_line(case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    text, cause = REFUSALS[case]
    path = written(tmp_path / "volume.cube", text)
    with pytest.raises(BadInput) as refusal:
        read_whole(str(path))
    assert cause in str(refusal.value) and str(path) in str(refusal.value)
    assert "\n" not in str(refusal.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("share", [0.001, 0.5, 0.99])
def test_truncated_gzip_is_refused(share: float, tmp_path: Path) -> None:
    packed = gzip.compress(cube_text(values_of(1, (20, 30, 40))[..., 0]).encode())
    path = tmp_path / "volume.cube.gz"
    path.write_bytes(packed[: int(len(packed) * share) + 20])
    with pytest.raises(BadInput, match="gzip data is damaged or truncated"):
        read_whole(str(path))
