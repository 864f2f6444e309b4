"""MTZ files made of noise, whose phases are as their group's symmetry allows."""

import math
from pathlib import Path
from typing import Any

import gemmi
import numpy as np

CELL = gemmi.UnitCell(9.0, 12.0, 14.0, 90, 104, 90)
RESOLUTION = 2.5


def reflections(group: str, resolution: float = RESOLUTION) -> tuple[Any, Any, Any]:
    """Indices of an asymmetric unit, amplitudes, and phases as the group's symmetry allows."""
    space_group = gemmi.SpaceGroup(group)
    indices = gemmi.make_miller_array(CELL, space_group, resolution)
    generator = np.random.default_rng(1)
    amplitudes = generator.uniform(10, 100, len(indices)).astype(np.float32)
    phases = generator.uniform(-180, 180, len(indices)).astype(np.float32)
    operations = space_group.operations()
    for n, index in enumerate(indices.tolist()):
        if operations.is_reflection_centric(index):  # then a phase is one of two
            shift = next(one.phase_shift(index) for one in operations if one.apply_to_hkl(index) == [-h for h in index])
            phases[n] = math.degrees(-shift / 2)
    return indices, amplitudes, phases


def mtz(path: Path, group: str = "P 1 21 1", columns: str = "FWT:F PHWT:P", resolution: float = RESOLUTION) -> Path:
    """An MTZ file whose columns are amplitudes (F), phases (P) or intensities (J)."""
    indices, amplitudes, phases = reflections(group, resolution)
    made = gemmi.Mtz(with_base=True)
    made.spacegroup = gemmi.SpaceGroup(group)
    made.set_cell_for_all(CELL)
    made.add_dataset("made").wavelength = 1.0
    values = {"F": amplitudes, "P": phases, "J": amplitudes**2}
    table = [*indices.T]
    for column in columns.split():
        label, kind = column.split(":")
        made.add_column(label, kind)
        table.append(values[kind])
    made.set_data(np.stack(table, axis=1).astype(np.float32))
    made.write_to_file(str(path))
    return path
