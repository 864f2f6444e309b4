"""Structure factors: maps, Patterson functions and frequencies against sums written out here; models in their maps."""

import cmath
import gzip
import math
import struct
from collections.abc import Callable
from pathlib import Path

import gemmi
import numpy as np
import pytest
import torch

import tolerances
from support.files.opened import refused
from support.files.reflection_files import CELL, RESOLUTION, mtz, reflections
from volsplat.client.session.session import Session
from volsplat.client.session.single import SingleProcess
from volsplat.client.volume.file_voxel import FileVoxel
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.open_volume import parts_of
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.scene import Image, Scene
from volsplat.protocol.description.shading_tables import ColourTable, CrossBar, Field, ScalarTable, Tables
from volsplat.protocol.description.volume import Box, Geometry
from volsplat.protocol.geometry import matrices

GROUPS = ("P 1", "P 1 21 1", "C 1 2 1")


def read_whole(path: Path | str) -> tuple[Geometry, Voxels]:
    reader = open_volume(str(path))
    geometry = reader.description.geometry
    return geometry, reader.read(geometry.box)


def frequencies(path: Path) -> dict[tuple[int, ...], complex]:
    """Every structure factor of the volume of frequencies, by its indices."""
    reader = open_volume(f"{path}#frequency")
    assert reader.read_second is not None
    description = reader.description
    amplitudes, phases = (read(description.geometry.box) for read in (reader.read, reader.read_second))
    assert description.axes is not None
    first = [round(axis.first) for axis in description.axes]
    found = {}
    for k, j, i in zip(*np.nonzero(np.isfinite(amplitudes)), strict=True):
        index = tuple(int(n) + low for n, low in zip((i, j, k), first, strict=True))
        assert 0.0 <= phases[k, j, i] < 360.0
        found[index] = cmath.rect(float(amplitudes[k, j, i]), math.radians(float(phases[k, j, i])))
    np.testing.assert_array_equal(np.isnan(amplitudes), np.isnan(phases))
    return found


@pytest.mark.parametrize("flag", [-999.0, 0.0, 7.25])
def test_what_an_mtz_file_flags_as_missing_is_not_there(flag: float, tmp_path: Path) -> None:
    whole = mtz(tmp_path / "whole.mtz", "P 1")
    left_out, flagged = (gemmi.read_mtz_file(str(whole)) for _ in range(2))
    table = np.array(left_out)
    missing = (np.abs(table[:, 0]) == 1) | (table[:, 3] < 20)
    left_out.set_data(table[~missing])
    table[missing, 3:] = flag
    flagged.set_data(table)
    flagged.valm = flag
    for name, made in (("left_out.mtz", left_out), ("flagged.mtz", flagged)):
        made.write_to_file(str(tmp_path / name))
    assert frequencies(tmp_path / "flagged.mtz") == frequencies(tmp_path / "left_out.mtz")


@pytest.mark.parametrize("group", GROUPS)
def test_a_map_is_the_sum_over_all_frequencies(group: str, tmp_path: Path) -> None:
    path = mtz(tmp_path / "made.mtz", group)
    factors = frequencies(path)
    geometry, density = read_whole(path)
    for i, j, k in ((0, 0, 0), (3, 1, 7), (10, 11, 12), (geometry.dims[0] - 1, 2, 5)):
        place = [n / size for n, size in zip((i, j, k), geometry.dims, strict=True)]
        waves = (
            factor * cmath.exp(-2j * math.pi * sum(h * x for h, x in zip(index, place, strict=True)))
            for index, factor in factors.items()
        )
        total = sum(waves) / CELL.volume
        assert density[k, j, i] == pytest.approx(total.real, rel=tolerances.SAME_NUMBERS, abs=tolerances.SAME_NUMBERS)
        assert abs(total.imag) < tolerances.SAME_NUMBERS


@pytest.mark.parametrize("group", GROUPS)
def test_a_patterson_function_is_the_sum_of_squared_amplitudes(group: str, tmp_path: Path) -> None:
    path = mtz(tmp_path / "made.mtz", group)
    squares = {index: abs(factor) ** 2 for index, factor in frequencies(path).items()}
    geometry, values = read_whole(f"{path}#patterson")
    assert (
        values.max()
        == values[0, 0, 0]
        == pytest.approx(sum(squares.values()) / CELL.volume, rel=tolerances.SPLAT_FLOAT32)
    )
    for i, j, k in ((3, 1, 7), (10, 11, 12)):
        place = [n / size for n, size in zip((i, j, k), geometry.dims, strict=True)]
        total = sum(
            square * math.cos(2 * math.pi * sum(h * x for h, x in zip(index, place, strict=True)))
            for index, square in squares.items()
        )
        scale = float(values.max())
        assert values[k, j, i] / scale == pytest.approx(total / CELL.volume / scale, abs=tolerances.SAME_NUMBERS)


@pytest.mark.parametrize("group", GROUPS)
def test_frequencies_fill_the_sphere_by_symmetry_and_friedels_law(group: str, tmp_path: Path) -> None:
    factors = frequencies(mtz(tmp_path / "made.mtz", group))
    everywhere = gemmi.make_miller_array(CELL, gemmi.SpaceGroup("P 1"), RESOLUTION).tolist()
    operations = gemmi.SpaceGroup(group).operations()
    allowed = {tuple(index) for index in everywhere if not operations.is_systematically_absent(index)}
    assert {index for index in factors if index in allowed or tuple(-h for h in index) in allowed} == set(factors)
    assert len(factors) == 2 * len(allowed)
    for index, factor in factors.items():
        mate = factors[tuple(-h for h in index)]
        assert mate == pytest.approx(factor.conjugate(), rel=tolerances.SPLAT_FLOAT32, abs=tolerances.SPLAT_FLOAT32)


def test_the_measured_values_are_at_their_indices(tmp_path: Path) -> None:
    factors = frequencies(mtz(tmp_path / "made.mtz"))
    indices, amplitudes, phases = reflections("P 1 21 1")
    for index, amplitude, phase in zip(indices.tolist(), amplitudes, phases, strict=True):
        expected = cmath.rect(float(amplitude), math.radians(float(phase)))
        assert factors[tuple(index)] == pytest.approx(expected, rel=tolerances.SAME_NUMBERS)


def test_frequencies_lie_as_far_out_as_they_resolve(tmp_path: Path) -> None:
    description = open_volume(f"{mtz(tmp_path / 'made.mtz')}#amplitude").description
    assert description.unit == "1/Å" and description.density_name == "amplitude"
    assert description.strength_name == "gradient strength" and description.second_scalar is None
    assert description.axes is not None and [axis.name for axis in description.axes] == ["h", "k", "l"]
    first = [axis.first for axis in description.axes]
    for index in ((0, 0, 0), (1, 0, 0), (2, 3, -1), (-3, 1, 2)):
        at = tuple(float(h) - low for h, low in zip(index, first, strict=True))
        place = description.geometry.physical((at[0], at[1], at[2]))
        out = 1 / CELL.calculate_d(list(index)) if any(index) else 0.0
        assert matrices.length(place) == pytest.approx(out, abs=tolerances.GEOMETRY_FLOAT64)


def test_boxes_are_slices(tmp_path: Path) -> None:
    path = mtz(tmp_path / "made.mtz")
    for part in ("map", "patterson", "amplitude", "frequency"):
        reader = open_volume(f"{path}#{part}")
        box = Box((1, 2, 0), (4, 5, 6))
        whole = reader.read(reader.description.geometry.box)
        got = reader.read(box)
        assert got.flags.c_contiguous and got.dtype == np.float32
        np.testing.assert_array_equal(got, whole[0:6, 2:5, 1:4])


def test_columns_are_chosen_by_their_labels(tmp_path: Path) -> None:
    path = mtz(tmp_path / "made.mtz", columns="FP:F I:J FWT:F PHWT:P FC:F PHIC:P")
    default = open_volume(str(path)).description
    assert "map of FWT,PHWT" in default.format
    chosen = open_volume(f"{path}#map:FC,PHIC").description
    assert "map of FC,PHIC" in chosen.format
    np.testing.assert_array_equal(read_whole(path)[1], read_whole(f"{path}#map:FP,PHIC")[1])  # the same numbers
    assert "amplitude of FP" in open_volume(f"{path}#amplitude").description.format
    measured, root = read_whole(f"{path}#amplitude")[1], read_whole(f"{path}#amplitude:I")[1]
    np.testing.assert_allclose(root, measured, rtol=tolerances.SPLAT_FLOAT32)


def test_a_lone_pair_needs_no_names(tmp_path: Path) -> None:
    path = mtz(tmp_path / "made.mtz", columns="Fx:F phix:P")
    assert "map of Fx,phix" in open_volume(str(path)).description.format


def test_negative_intensities_are_told(tmp_path: Path) -> None:
    path = mtz(tmp_path / "made.mtz", columns="I:J")
    read = gemmi.read_mtz_file(str(path))
    table = np.array(read)
    table[:3, 3] = -1.0
    read.set_data(table)
    read.write_to_file(str(path))
    description = open_volume(f"{path}#amplitude").description
    assert description.warnings == ("3 intensities below 0 are taken as 0",)


def test_mmcif_and_mtz_are_the_same(shared_data: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = shared_data / "structure_factors/r5wkdsf.ent"
    block = gemmi.as_refln_blocks(gemmi.cif.read(str(path)))[0]
    gemmi.CifToMtz().convert_block_to_mtz(block).write_to_file(str(tmp_path / "converted.mtz"))
    capfd.readouterr()
    for part in ("map", "frequency"):
        one, other = open_volume(f"{path}#{part}"), open_volume(f"{tmp_path / 'converted.mtz'}#{part}")
        assert one.description.geometry == other.description.geometry
        box = one.description.geometry.box
        np.testing.assert_allclose(
            one.read(box), other.read(box), rtol=tolerances.SPLAT_FLOAT32, atol=tolerances.SPLAT_FLOAT32
        )
    assert capfd.readouterr() == ("", "")


def test_real_structure_factors_are_as_their_table_says(shared_data: Path) -> None:
    density = open_volume(str(shared_data / "structure_factors/r5wkdsf.ent")).description
    assert density.format == "structure-factor mmCIF, 406 reflections, map of pdbx_FWT,pdbx_PHWT to 1.8 Å"
    assert density.geometry.dims == (120, 12, 36) and density.unit == "Å"
    corner = density.geometry.physical((120.0, 12.0, 36.0))
    cell = gemmi.UnitCell(50.347, 4.777, 14.746, 90, 101.733, 90)
    assert corner == pytest.approx(
        cell.orthogonalize(gemmi.Fractional(1, 1, 1)).tolist(), rel=tolerances.GEOMETRY_FLOAT64
    )
    amplitude = open_volume(f"{shared_data / 'structure_factors/5e5z.mtz'}#amplitude").description
    assert amplitude.geometry.dims == (11, 11, 23)
    assert "403 reflections, amplitude of FP" in amplitude.format


def test_a_model_lies_in_the_map_of_its_structure_factors(shared_data: Path) -> None:
    geometry, density = read_whole(shared_data / "structure_factors/r5wkdsf.ent")
    model = gemmi.read_structure(str(shared_data / "structure_factors/5wkd.pdb"))[0]
    to_index = matrices.inverse(geometry.index_to_physical)
    model.remove_waters()
    heights = []
    for atom in (atom for chain in model for residue in chain for atom in residue):
        place = matrices.applied(to_index, (atom.pos.x, atom.pos.y, atom.pos.z))
        i, j, k = (round(x) % size for x, size in zip(place, geometry.dims, strict=True))
        heights.append(float(density[k, j, i]))
    assert len(heights) == 48
    assert min(heights) > np.percentile(density, 75)
    assert np.median(heights) > np.percentile(density, 96)


def test_phases_reach_the_packets_and_the_probe(tmp_path: Path) -> None:
    """The same image from one process and from two servers, and the phase of what is under the pointer."""
    name = f"{mtz(tmp_path / 'made.mtz')}#frequency"
    reader = open_volume(name)
    assert reader.read_second is not None
    box = reader.description.geometry.box
    amplitudes, phases = reader.read(box), reader.read_second(box)
    scene = Scene(
        tables=Tables(
            emit=ColourTable(points=((0.0, (1.0, 0.0, 0.0)), (1.0, (0.0, 1.0, 0.0)))),
            refl=ColourTable(points=((0.0, (0.0, 0.0, 0.0)),)),
            opac=ScalarTable(points=((0.3, 0.0), (0.3, 1.0))),
        ),
        cross_bar=CrossBar(emit=Field.STRENGTH),
        image=Image(width=64, height=64),
    )
    with SingleProcess(name) as single, Session(name, workers=2) as session:
        assert torch.equal(single.render(scene), session.render(scene))
        volume = session.volume
        assert volume.strength_counts == single.volume.strength_counts
        assert sum(volume.strength_counts) == int(np.isfinite(phases).sum())
        seen = session.probe(scene, 32.0, 32.0)
        assert seen == single.probe(scene, 32.0, 32.0) and seen is not None
        i, j, k = seen.index
        own = FileVoxel(float(amplitudes[k, j, i]), float(phases[k, j, i]), ("float32", "float32"))
        assert session.file_voxel(seen.index) == single.file_voxel(seen.index) == own
    half_a_byte = 360 / 255 / 2 * (1 + tolerances.SAME_NUMBERS)
    assert abs(seen.strength - float(phases[k, j, i])) <= half_a_byte
    assert np.isfinite(amplitudes[k, j, i])


def cut(path: Path, size: int) -> Path:
    path.write_bytes(path.read_bytes()[:size])
    return path


def changed(path: Path, offset: int, new: bytes) -> Path:
    raw = bytearray(path.read_bytes())
    raw[offset : offset + len(new)] = new
    path.write_bytes(raw)
    return path


def replaced(path: Path, old: bytes, new: bytes) -> Path:
    raw = path.read_bytes()
    assert old in raw and len(old) == len(new)
    path.write_bytes(raw.replace(old, new))
    return path


def made(folder: Path, columns: str = "FWT:F PHWT:P") -> Path:
    return mtz(folder / "made.mtz", columns=columns)


def named(path: Path, part: str) -> Path:
    return Path(f"{path}#{part}")


def unmerged(folder: Path) -> Path:
    read = gemmi.read_mtz_file(str(made(folder)))
    read.batches.append(gemmi.Mtz.Batch())
    read.write_to_file(str(folder / "unmerged.mtz"))
    return folder / "unmerged.mtz"


CIF_HEAD = (
    "data_r1\n_cell.length_a 10\n_cell.length_b 10\n_cell.length_c 10\n_cell.angle_alpha 90\n_cell.angle_beta 90\n"
)
CIF_HEAD += "_cell.angle_gamma 90\n_symmetry.space_group_name_H-M 'P 1'\n"
CIF_LOOP = "loop_\n_refln.index_h\n_refln.index_k\n_refln.index_l\n_refln.F_meas_au\n"


def cif(folder: Path, text: str) -> Path:
    (folder / "factors.cif").write_text(text)
    return folder / "factors.cif"


REFUSALS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "no phases": (lambda d: made(d, columns="FP:F I:J"), "amplitudes FP; intensities I; without phases there is no"),
    "no phases but a map is asked for": (lambda d: named(made(d, columns="FP:F"), "map"), "name an amplitude and its"),
    "no amplitudes": (lambda d: named(made(d, columns="X:P"), "amplitude"), "phases X; name a column"),
    "no such part": (lambda d: named(made(d), "density"), "it is one of map, patterson, amplitude, frequency"),
    "no such pair": (lambda d: named(made(d), "map:FWT,PHIC"), "“FWT,PHIC” is no pair of them: name an"),
    "no such column": (lambda d: named(made(d), "patterson:FP"), "“FP” is none of them; name a column"),
    "unknown pairs": (
        lambda d: made(d, columns="A:F B:F PA:P PB:P"),
        "which belong together is not known: name an amplitude and its phase, as in",
    ),
    "truncated": (lambda d: cut(made(d), 2000), "truncated"),
    "head truncated": (lambda d: cut(made(d), 12), "truncated"),
    "header beyond the file": (lambda d: changed(made(d), 4, struct.pack("<i", 1 << 30)), "more than the file holds"),
    "more reflections than there are": (
        lambda d: replaced(p := made(d), ncol(p), ncol(p, 9000000)),
        "more than the file",
    ),
    "no cell": (lambda d: replaced(made(d), b"9.0000   12.0000", b"0.0000    0.0000"), "states no cell"),
    "unmerged": (unmerged, "merge them first"),
    "compressed": (lambda d: zipped(made(d)), "is compressed; unzip it first"),
    "mmCIF without a cell": (lambda d: cif(d, "data_r1\n" + CIF_LOOP + "1 0 0 5.0\n"), "states no cell"),
    "mmCIF without values": (
        lambda d: named(cif(d, CIF_HEAD + CIF_LOOP + "1 0 0 ?\n"), "amplitude"),
        "none of its refl",
    ),
    "mmCIF without such a block": (
        lambda d: named(cif(d, CIF_HEAD + CIF_LOOP + "1 0 0 5.0\n"), "amplitude,block=r2"),
        "has no block r2 with reflections; there are r1",
    ),
    "absurd amplitudes": (
        lambda d: named(cif(d, CIF_HEAD + CIF_LOOP + "1 0 0 1e20\n"), "patterson"),
        "its amplitudes reach 1e+40",
    ),
    "an index that is no number": (lambda d: cif(d, CIF_HEAD + CIF_LOOP + "x 0 0 5.0\n"), "not an integer"),
    "absurd indices": (
        lambda d: named(cif(d, CIF_HEAD + CIF_LOOP + "9000 9000 9000 5.0\n"), "amplitude"),
        "18001 x 18001 x 18001 voxels",
    ),
}


def ncol(path: Path, count: int | None = None) -> bytes:
    """The header's record of columns and reflections, or one that promises `count` of these."""
    raw = path.read_bytes()
    start = raw.index(b"NCOL")
    record = raw[start : start + 80]
    return record if count is None else f"NCOL {5:8d} {count:12d} {0:8d}".ljust(80).encode()


def zipped(path: Path) -> Path:
    packed = path.with_name("made.mtz.gz")
    packed.write_bytes(gzip.compress(path.read_bytes()))
    return packed


@pytest.mark.parametrize("case", REFUSALS)
def test_bad_structure_factors_are_refused_in_one_line(
    case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    make, cause = REFUSALS[case]
    path = make(tmp_path)
    capfd.readouterr()
    text = refused(path)
    assert cause in text and str(tmp_path) in text
    assert capfd.readouterr() == ("", "")


def test_a_block_is_chosen_by_its_name(tmp_path: Path) -> None:
    second = (CIF_HEAD + CIF_LOOP + "2 0 0 7.0\n").replace("data_r1", "data_r2")
    path = cif(tmp_path, CIF_HEAD + CIF_LOOP + "1 0 0 5.0\n" + second)
    first = open_volume(f"{path}#amplitude").description
    assert first.geometry.dims == (3, 1, 1) and "of the blocks r1, r2 the first is shown" in first.warnings[0]
    chosen = open_volume(f"{path}#amplitude,block=r2").description
    assert chosen.geometry.dims == (5, 1, 1) and not chosen.warnings
    assert [part for part, _ in parts_of(str(path))] == ["block=r1", "block=r2"]
    told = parts_of(f"{path}#block=r2")
    assert told and all(one.part.endswith(",block=r2") for one in told)
    assert open_volume(f"{path}#{told[-1].part}").description.geometry.dims == (5, 1, 1)
