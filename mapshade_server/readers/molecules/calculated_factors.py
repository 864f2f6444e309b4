"""Structure factors that a model's atoms would scatter, through gemmi: electron density of the cell, and its transform.

Atoms scatter X-rays by the form factors of the International Tables (C, 6.1.1.4, four Gaussians and a constant), each
smeared by its temperature factor; symmetry and neighbouring cells are counted in.
"""

from pathlib import Path
from typing import Any

import numpy as np

from volsplat.mapshade_server.readers.molecules.gemmi_errors import one_line_errors
from volsplat.mapshade_server.readers.molecules.reflections import Reflections
from volsplat.mapshade_server.readers.reading.extra import library
from volsplat.protocol.text.errors import BadInput

AMPLITUDE, PHASE = "FC", "PHIC"
MOST_INDEX = 32  # along the longest edge of the cell, if nobody states a resolution
FINEST, COARSEST = 0.8, 50.0  # resolution, Å
MARGIN = 10.0  # Å of nothing about a molecule that has no cell
USUAL_B = 20.0  # Å², if the file has none
MOST_GRID_POINTS = 1 << 28


def calculated_reflections(
    path: Path, structure: Any, model: Any, resolution: float | None, warnings: list[str]
) -> Reflections:
    """The reflections of gemmi's model to a resolution in Å, with amplitude and phase.

    The cell and the space group are the structure's; a molecule that has none gets a box of its own. Raises BadInput.
    """
    gemmi = library("gemmi", "atoms")
    _put_into_cell(gemmi, structure, model, warnings)
    cell = structure.cell
    longest = max(cell.a, cell.b, cell.c)
    if resolution is None:
        resolution = min(max(longest / MOST_INDEX, FINEST), COARSEST)
    if not FINEST <= resolution <= COARSEST:
        raise BadInput(f"{path}: a resolution of {resolution:g} Å cannot be drawn; give {FINEST:g} to {COARSEST:g}")
    calculator = gemmi.DensityCalculatorX()
    calculator.d_min = resolution
    points = cell.volume * (2 * calculator.rate / resolution) ** 3
    if not points <= MOST_GRID_POINTS:
        least = float(f"{1.05 * resolution * (points / MOST_GRID_POINTS) ** (1 / 3):.1e}")
        raise BadInput(
            f"{path}: its cell is too large for a resolution of {resolution:g} Å; give at least {least:g}, "
            f"as in {path}#frequency,{least:g}"
        )
    _smear(model, warnings)
    with one_line_errors(path, "set of atoms"):
        calculator.set_refmac_compatible_blur(model)
        calculator.set_grid_cell_and_spacegroup(structure)
        calculator.put_model_density_on_grid(model)
        transform = gemmi.transform_map_to_f_phi(calculator.grid, half_l=True)
        data = transform.prepare_asu_data(dmin=resolution, unblur=calculator.blur)
    if not len(data.value_array):
        raise BadInput(f"{path}: its cell has no reflection to {resolution:g} Å; give a finer resolution")
    factors = np.array(data.value_array, np.complex128)
    return Reflections(
        path=path,
        cell=cell,
        space_group=calculator.grid.spacegroup,
        indices=np.array(data.miller_array, np.int64),
        amplitudes={AMPLITUDE: np.abs(factors)},
        phases={PHASE: np.degrees(np.angle(factors)) % 360.0},
        intensities={},
        warnings=tuple(warnings),
    )


def _put_into_cell(gemmi: Any, structure: Any, model: Any, warnings: list[str]) -> None:
    """Give the structure a cell and a space group if its file states none."""
    if structure.cell.is_crystal():
        structure.standardize_crystal_frame()
        if structure.find_spacegroup() is None:
            warnings.append("the file states no space group; P 1 is taken")
            structure.spacegroup_hm = "P 1"
    else:
        places = np.array([atom.pos.tolist() for chain in model for residue in chain for atom in residue])
        edges = np.ceil(places.max(axis=0) - places.min(axis=0)) + MARGIN
        structure.cell = gemmi.UnitCell(*(float(edge) for edge in edges), 90, 90, 90)
        structure.spacegroup_hm = "P 1"
        box = " x ".join(f"{edge:g}" for edge in edges)
        warnings.append(f"the file states no cell; a box of {box} Å about the molecule is taken as one")
    structure.setup_cell_images()


def _smear(model: Any, warnings: list[str]) -> None:
    """Atoms without any temperature factor get the usual one: points would scatter to any resolution."""
    atoms = [atom for chain in model for residue in chain for atom in residue]
    if not any(atom.b_iso for atom in atoms):
        warnings.append(f"the atoms have no temperature factors; {USUAL_B:g} Å² is taken")
        for atom in atoms:
            atom.b_iso = USUAL_B
