"""Structure factors of atoms: against the sum over atoms written out here, and against measured ones."""

import cmath
import math
from pathlib import Path

import gemmi
import numpy as np
import pytest

from volsplat.mapshade_server.readers import open_volume
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.volume import VolumeDescription
from volsplat.protocol.text.errors import BadInput

Factors = dict[tuple[int, int, int], complex]

ATOMS = (("C", (1.0, 2.0, 3.0)), ("N", (2.2, 2.9, 3.1)), ("O", (4.0, 1.2, 5.5)), ("S", (6.1, 6.2, 2.4)))
B = 15.0  # Å²


def molecule(path: Path, group: str = "P 1 21 1", cell: bool = True, b: float = B) -> Path:
    """A PDB file of four atoms."""
    lines = [f"CRYST1{12:9.3f}{14:9.3f}{16:9.3f}{90:7.2f}{104:7.2f}{90:7.2f} {group}"] if cell else []
    for n, (element, (x, y, z)) in enumerate(ATOMS, start=1):
        lines.append(
            f"HETATM{n:5d} {element:<3}  LIG A   1    {x:8.3f}{y:8.3f}{z:8.3f}{1:6.2f}{b:6.2f}          {element:>2}"
        )
    path.write_text("\n".join([*lines, "END", ""]))
    return path


def frequencies(name: str) -> tuple[VolumeDescription, Factors]:
    """Every structure factor of a volume of frequencies, by its indices."""
    reader = open_volume(name)
    assert reader.read_second is not None
    description = reader.description
    amplitudes, phases = (read(description.geometry.box) for read in (reader.read, reader.read_second))
    assert description.axes is not None
    h0, k0, l0 = (round(axis.first) for axis in description.axes)
    found = {}
    for k, j, i in zip(*np.nonzero(np.isfinite(amplitudes)), strict=True):
        found[int(i) + h0, int(j) + k0, int(k) + l0] = cmath.rect(
            float(amplitudes[k, j, i]), math.radians(float(phases[k, j, i]))
        )
    return description, found


def summed(structure: gemmi.Structure, index: tuple[int, int, int]) -> complex:
    """The scattering of all atoms of the cell, one by one (International Tables B, 1.2.4)."""
    cell = structure.cell
    stol2 = 0.25 * cell.calculate_1_d2(index)
    total = 0j
    for operation in structure.find_spacegroup().operations():
        for site in structure[0].all():
            place = operation.apply_to_xyz(cell.fractionalize(site.atom.pos).tolist())
            form = site.atom.element.it92.calculate_sf(stol2) * math.exp(-site.atom.b_iso * stol2)
            total += form * cmath.exp(2j * math.pi * sum(h * x for h, x in zip(index, place, strict=True)))
    return total


@pytest.mark.parametrize("group", ["P 1", "P 1 21 1"])
def test_they_are_the_sum_over_the_atoms(tmp_path: Path, group: str) -> None:
    path = molecule(tmp_path / "made.pdb", group)
    description, factors = frequencies(f"{path}#frequency,1.5")
    structure = gemmi.read_structure(str(path))
    greatest = max(abs(factor) for factor in factors.values())
    indices = sorted(factors)[:: max(1, len(factors) // 60)]
    for index in indices:
        assert abs(factors[index] - summed(structure, index)) < 2e-3 * greatest, index
    assert description.kind == Kind.STRUCTURE_FACTORS
    assert (0, 0, 0) not in factors  # the number of electrons, which would outshine all others


def test_they_have_the_symmetry_of_real_densities(tmp_path: Path) -> None:
    _, factors = frequencies(f"{molecule(tmp_path / 'made.pdb')}#frequency")
    for (h, k, l), factor in factors.items():  # noqa: E741 - its name everywhere
        assert abs(factors[-h, -k, -l] - factor.conjugate()) < 1e-3 * (1 + abs(factor))


def test_a_resolution_is_kept(tmp_path: Path) -> None:
    path = molecule(tmp_path / "made.pdb")
    cell = gemmi.read_structure(str(path)).cell
    for resolution in (1.2, 3.0):
        _, factors = frequencies(f"{path}#frequency,{resolution}")
        finest = min(cell.calculate_d(index) for index in factors)
        assert resolution <= finest < 1.1 * resolution


def test_what_a_file_lacks_is_taken_and_told(tmp_path: Path) -> None:
    description, factors = frequencies(f"{molecule(tmp_path / 'made.pdb', cell=False, b=0.0)}#frequency")
    told = " ".join(description.warnings)
    assert "states no cell; a box of 16 x 15 x 14 Å" in told and "no temperature factors; 20 Å²" in told
    assert factors


def test_amplitudes_alone_have_no_second_scalar(tmp_path: Path) -> None:
    reader = open_volume(f"{molecule(tmp_path / 'made.pdb')}#amplitude")
    assert reader.description.second_scalar is None
    assert reader.description.density_name == "amplitude"


@pytest.mark.parametrize(
    ("part", "cause"), [("frequency,0.1", "resolution of 0.1 Å"), ("frequencies", "frequency, amplitude, then")]
)
def test_a_bad_part_is_refused_with_the_cure(tmp_path: Path, part: str, cause: str) -> None:
    with pytest.raises(BadInput, match=cause) as refused:
        open_volume(f"{molecule(tmp_path / 'made.pdb')}#{part}")
    assert "\n" not in str(refused.value)


def test_a_model_scatters_as_its_crystal_did(shared_data: Path) -> None:
    folder = shared_data / "structure_factors"
    _, measured = frequencies(f"{folder / 'r5wkdsf.ent'}#frequency")
    _, calculated = frequencies(f"{folder / '5wkd.pdb'}#frequency,1.2,waters=keep")
    common = sorted(measured.keys() & calculated.keys())
    assert len(common) > 500
    a, b = (np.abs([factors[index] for index in common]) for factors in (measured, calculated))
    assert np.corrcoef(a, b)[0, 1] > 0.85


@pytest.mark.parametrize("name", ["sod/1JK9_l_u.pdb", "hemoglobin/4HHB.pdb", "maps/3ek3.cif"])
def test_real_molecules_scatter(shared_data: Path, name: str) -> None:
    description, factors = frequencies(f"{shared_data / name}#frequency")
    assert max(description.geometry.dims) in range(55, 67)
    assert len(factors) > 15_000
