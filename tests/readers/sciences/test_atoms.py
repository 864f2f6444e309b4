"""PDB and mmCIF coordinates: every atom is where gemmi has it, as high as its element; what is left out is told."""

import gzip
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import gemmi
import numpy as np
import pytest

import tolerances
from volsplat.client.session.single import SingleProcess
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.molecules.atom_density import BAND, CLASSES, MOST_VOXELS_ASIDE
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.volume import Box, Geometry
from volsplat.protocol.text.errors import BadInput

REAL = {  # format, atoms, waters, spacing
    "hemoglobin/4HHB.pdb": ("PDB", 4558, 221, 0.42),
    "trna/1ehz.pdb": ("PDB", 1661, 160, 0.46),
    "sod/1JK9_l_u.pdb": ("PDB", 1106, 0, 0.27),
    "maps/3ek3.cif": ("mmCIF", 1545, 205, 0.36),
    "structure_factors/5wkd.pdb": ("PDB", 48, 2, 0.2),
    "structure_factors/5e5z.pdb": ("PDB", 46, 1, 0.2),
}


def read_whole(path: Path | str) -> tuple[Geometry, Voxels]:
    reader = open_volume(str(path))
    geometry = reader.description.geometry
    return geometry, reader.read(geometry.box)


def value_at(geometry: Geometry, values: Voxels, place: gemmi.Position) -> float:
    """The greatest value of the eight voxels around a place."""
    spacing = geometry.spacing[0]
    i, j, k = (math.floor((x - start) / spacing) for x, start in zip(place.tolist(), geometry.origin, strict=True))
    return float(values[k : k + 2, j : j + 2, i : i + 2].max())


@pytest.mark.parametrize("name", REAL)
def test_a_real_molecule_has_its_atoms_where_gemmi_has_them(
    name: str, shared_data: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    kind, count, waters, spacing = REAL[name]
    description = open_volume(f"{shared_data / name}#density").description
    geometry, values = read_whole(f"{shared_data / name}#density")
    assert description.format == f"{kind}, {count} atoms as a synthetic electron density"
    assert description.unit == "Å" and description.scalar_type == "float32" and not description.anatomical
    assert max(geometry.dims) <= MOST_VOXELS_ASIDE and geometry.spacing[0] == spacing
    assert bool(description.warnings) == bool(waters)
    assert not waters or f"{waters} waters are left out" in description.warnings[0]
    atoms = gemmi.read_structure(str(shared_data / name))[0]
    atoms.remove_waters()
    for atom in (atom for chain in atoms for residue in chain for atom in residue):
        sigma = max(atom.element.covalent_r / 2, 0.7 * spacing)
        least = atom.occ * atom.element.atomic_number * math.exp(-3 * (spacing / 2) ** 2 / (2 * sigma**2))
        assert value_at(geometry, values, atom.pos) >= least * (1 - tolerances.SAME_NUMBERS)
    assert capfd.readouterr() == ("", "")


def test_elements_have_their_bands_at_real_atoms(shared_data: Path) -> None:
    path = shared_data / "hemoglobin/4HHB.pdb"
    description = open_volume(f"{path}#elements").description
    assert description.scalar_type == "uint8" and description.density_name == "element"
    bands = {band.name: (band.low, band.high) for band in description.bands}
    assert bands["C"] == (64, 95) and bands["N"] == (96, 127) and bands["O"] == (128, 159)
    geometry, values = read_whole(f"{path}#elements")
    model = gemmi.read_structure(str(path))[0]
    model.remove_waters()
    seen = set()
    for atom in (atom for chain in model for residue in chain for atom in residue):
        expected = CLASSES.index(atom.element.name if atom.element.name in CLASSES else "other")
        spacing = geometry.spacing[0]
        index = [round((x - low) / spacing) for x, low in zip(atom.pos.tolist(), geometry.origin, strict=True)]
        assert values[index[2], index[1], index[0]] // BAND == expected
        seen.add(expected)
    assert len(seen) == 6  # carbon, nitrogen, oxygen, phosphorus, sulphur, and iron as another one


def small() -> gemmi.Structure:
    """A serine with two places for its oxygen, a water and a zinc, in two models."""
    rows = (
        ("SER", "N", "N", (0.0, 0.0, 0.0), 1.0, "\0"),
        ("SER", "CA", "C", (1.45, 0.0, 0.0), 1.0, "\0"),
        ("SER", "CB", "C", (2.0, 1.4, 0.0), 1.0, "\0"),
        ("SER", "OG", "O", (3.4, 1.4, 0.2), 0.75, "A"),
        ("SER", "OG", "O", (1.6, 2.7, 0.2), 0.25, "B"),
        ("ZN", "ZN", "Zn", (5.3, 2.0, 1.0), 1.0, "\0"),
        ("HOH", "O", "O", (8.0, -3.0, 2.0), 1.0, "\0"),
    )
    structure = gemmi.Structure()
    for number in (1, 2):
        chain = gemmi.Chain("A")
        for name, label, element, place, occupancy, alternative in rows:
            if not len(chain) or chain[-1].name != name:
                residue = gemmi.Residue()
                residue.name, residue.seqid = name, gemmi.SeqId(len(chain) + 1, " ")
                residue.het_flag = "A" if name == "SER" else "H"
                chain.add_residue(residue)
            atom = gemmi.Atom()
            atom.name, atom.element, atom.occ, atom.altloc = label, gemmi.Element(element), occupancy, alternative
            atom.pos = gemmi.Position(*place) * number
            chain[-1].add_atom(atom)
        model = gemmi.Model(number)
        model.add_chain(chain)
        structure.add_model(model)
    structure.setup_entities()
    return structure


def pdb(folder: Path, models: int = 1, text: str | None = None) -> Path:
    structure = small()
    for number in range(2, models, -1):
        del structure[number - 1]
    path = folder / "small.pdb"
    path.write_text(structure.make_pdb_string() if text is None else text)
    return path


def pdb_text() -> str:
    structure = small()
    del structure[1]
    return str(structure.make_pdb_string())


def test_pdb_and_mmcif_plain_and_compressed_are_the_same(tmp_path: Path) -> None:
    structure = small()
    del structure[1]
    plain = pdb(tmp_path)
    mmcif = tmp_path / "small.cif"
    mmcif.write_text("# made for a test\n" + structure.make_mmcif_document().as_string())
    paths = [plain, mmcif]
    for path in (plain, mmcif):
        paths.append(path.with_suffix(path.suffix + ".gz"))
        paths[-1].write_bytes(gzip.compress(path.read_bytes()))
    paths.append(tmp_path / "named.ent")
    paths[-1].write_bytes(mmcif.read_bytes())
    for part in ("", "#density,0.4", "#elements,waters=keep"):
        (geometry, values), *others = (read_whole(f"{path}{part}") for path in paths)
        assert values.any()
        for other_geometry, other in others:
            assert other_geometry == geometry
            np.testing.assert_array_equal(other, values)


def test_heights_are_electrons_times_occupancy(tmp_path: Path) -> None:
    geometry, values = read_whole(f"{pdb(tmp_path)}#density,0.2")
    first, second = gemmi.Position(3.4, 1.4, 0.2), gemmi.Position(1.6, 2.7, 0.2)
    heights = [value_at(geometry, values, place) for place in (first, second)]
    assert 5.8 <= heights[0] < 6.5 and 1.8 <= heights[1] < 2.5  # between grid points, near neighbours


def test_waters_are_left_out_unless_they_are_asked_for(tmp_path: Path) -> None:
    water = gemmi.Position(8.0, -3.0, 2.0)
    left = open_volume(str(pdb(tmp_path))).description
    assert "1 waters are left out; small.pdb#elements,waters=keep keeps them" in left.warnings
    geometry, values = read_whole(f"{pdb(tmp_path)}#density,waters=keep")
    assert value_at(geometry, values, water) == pytest.approx(8.0, rel=tolerances.RANGE_PRINTED)
    assert not open_volume(f"{pdb(tmp_path)}#waters=keep").description.warnings


def test_a_model_is_chosen_by_its_number(tmp_path: Path) -> None:
    path = pdb(tmp_path, models=2)
    for part, said in {"": "elements", "#density,2": "density,2", "#waters=keep": "waters=keep"}.items():
        (told,) = (line for line in open_volume(f"{path}{part}").description.warnings if "models" in line)
        assert told == f"of 2 models the first is shown; small.pdb#{said},model=N shows another"
    first, second = read_whole(f"{path}#density,0.2")[0], read_whole(f"{path}#density,0.2,model=2")[0]
    assert first.dims < second.dims
    assert not open_volume(f"{path}#waters=keep,model=2").description.warnings


def test_step_g_is_told_to_need_the_density_of_the_atoms(tmp_path: Path) -> None:
    with SingleProcess(pdb(tmp_path)) as single, pytest.raises(BadInput, match="draw step F, or #density of atoms"):
        single.volume.check_step(Step.G)
    with SingleProcess(f"{pdb(tmp_path)}#density") as single:
        single.volume.check_step(Step.G)


def test_what_was_guessed_is_told(tmp_path: Path) -> None:
    unoccupied = pdb_text().replace("  1.00", "  0.00").replace("  0.75", "  0.00").replace("  0.25", "  0.00")
    cases = (
        (unoccupied, "occupancy 0"),
        (pdb_text().replace("END", "   "), "no END record"),
        (pdb_text().replace("          ZN  ", "              ").replace("ZN    ZN", "QX    ZN"), "no known element"),
    )
    for text, warning in cases:
        description = open_volume(f"{pdb(tmp_path, text=text)}#waters=keep").description
        assert len(description.warnings) == 1 and warning in description.warnings[0]


def test_letters_of_other_alphabets_leave_the_columns_where_they_are(tmp_path: Path) -> None:
    path = pdb(tmp_path)
    expected = read_whole(path)[1]
    path.write_bytes(path.read_bytes().replace(b"OG ASER", b"OG \xbfSER"))
    np.testing.assert_array_equal(read_whole(path)[1], expected)


def test_a_missing_library_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gemmi", None)
    with pytest.raises(
        BadInput, match=r"a PDB file needs gemmi, which is not installed: pip install 'volsplat\[formats"
    ):
        open_volume(str(pdb(tmp_path)))


def test_other_formats_do_not_import_gemmi() -> None:
    asked = "import sys, volsplat.mapshade_server.readers; print('gemmi' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True).stdout == "False\n"


def bomb(folder: Path) -> Path:
    path = folder / "bomb.pdb.gz"
    path.write_bytes(gzip.compress(pdb_text().encode() + b" " * 8_000_000))
    return path


def cut_gzip(folder: Path) -> Path:
    path = folder / "cut.pdb.gz"
    path.write_bytes(gzip.compress(pdb_text().encode())[:-20])
    return path


def changed(folder: Path, old: str, new: str) -> Path:
    text = pdb_text()
    assert old in text
    return pdb(folder, text=text.replace(old, new, 1))


def cif(folder: Path, text: str) -> Path:
    path = folder / "small.cif"
    path.write_text(text)
    return path


def part(path: Path, named: str) -> Path:
    return Path(f"{path}#{named}")


def crowded(folder: Path, count: int = 20_000, apart: float = 0.0) -> Path:
    """Atoms in a row; in one place if they lie 0 apart, as placeholders do."""
    line = "ATOM  {:5d}  C   ALA A{:4d}    {:8.3f}   0.000   0.000  1.00 20.00           C  \n"
    text = "".join(line.format(n % 100_000, n % 9999, n * apart) for n in range(count))
    return pdb(folder, text=f"{text}END\n")


def test_few_atoms_may_lie_in_one_place_and_many_in_a_row(tmp_path: Path) -> None:
    for count, apart in ((1000, 0.0), (20_000, 0.02)):
        reader = open_volume(str(crowded(tmp_path, count, apart)))
        assert reader.read(Box((0, 0, 0), (3, 3, 3))).shape == (3, 3, 3)


def test_a_long_line_of_an_atom_is_read_by_its_columns(tmp_path: Path) -> None:
    lines = pdb_text().splitlines()
    first = next(n for n, line in enumerate(lines) if line.startswith("ATOM"))
    for rest in (" " * 2_000_000, "x" * 2_000_000):
        lines[first] = lines[first].rstrip() + rest
        geometry, values = read_whole(pdb(tmp_path, text="\n".join(lines)))
        expected_geometry, expected = read_whole(pdb(tmp_path))
        assert geometry == expected_geometry
        np.testing.assert_array_equal(values, expected)


REFUSALS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "no atoms": (lambda d: pdb(d, text="HEADER    NOTHING\nEND\n"), "has no atoms"),
    "nothing but an extension": (lambda d: pdb(d, text="no molecule\n"), "has no atoms"),
    "broken coordinates": (lambda d: changed(d, "   1.450   0.000", "   1.4x0   0.000"), "line 4 has no three coord"),
    "a long line of blanks": (
        lambda d: changed(d, "   1.450   0.000   0.000", f"   1.450{' ' * 2_000_000}x"),
        "line 4 has no three coord",
    ),
    "coordinates missing": (lambda d: pdb(d, text=pdb_text()[:-130]), "has no three coord"),
    "compressed data truncated": (cut_gzip, "damaged or truncated"),
    "unpacks to too much": (bomb, "bytes of text unpacked"),
    "a spacing of 0": (lambda d: part(pdb(d), "density,0"), "a spacing of 0 Å cannot be"),
    "a spacing of NaN": (lambda d: part(pdb(d), "elements,nan"), "a spacing of nan Å cannot be"),
    "a spacing too fine": (lambda d: part(pdb(d), "0.0001"), "too far for a spacing of 0.0001 Å; give at least 0.0014"),
    "an atom far away": (lambda d: changed(d, "   1.450   0.000", "9999.000   0.000"), "give at least 2.7"),
    "no such part": (lambda d: part(pdb(d), "waters"), "then a spacing or resolution in Å, as in"),
    "two spacings": (lambda d: part(pdb(d), "density,1,2"), "then a spacing or resolution in Å, as in"),
    "no such model": (lambda d: part(pdb(d, models=2), "model=3"), "its models are 1, 2"),
    "no such choice": (lambda d: part(pdb(d), "waters=maybe"), "neither waters=keep nor waters=leave"),
    "atoms in one place": (crowded, "20000 atoms lie in too few places"),
    "elements in one place": (lambda d: part(crowded(d), "elements"), "20000 atoms lie in too few places"),
    "mmCIF without a coordinate": (
        lambda d: cif(d, small().make_mmcif_document().as_string().replace(" 1.45 ", " ? ")),
        "coordinates or occupancy are not numbers",
    ),
    "mmCIF of nothing": (lambda d: cif(d, "data_x\n_cell.length_a 3\n"), "an mmCIF file without atoms or reflections"),
    "mmCIF damaged": (lambda d: cif(d, "data_x\nloop_\n_a.b\n_a.c\n1 2 3\n"), "Wrong number of values in loop _a."),
    "CIF of a small molecule": (
        lambda d: cif(d, "data_x\nloop_\n_atom_site_label\n_atom_site_fract_x\nC1 0.5\n"),
        "a CIF of a small molecule",
    ),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_bad_molecules_are_refused_in_one_line(case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    make, cause = REFUSALS[case]
    path = make(tmp_path)
    with pytest.raises(BadInput) as refusal:
        open_volume(str(path))
    text = str(refusal.value)
    assert cause in text and "\n" not in text and str(tmp_path) in text
    assert capfd.readouterr() == ("", "")
