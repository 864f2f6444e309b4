"""Reflections of a crystal from MTZ files and structure-factor mmCIF, through gemmi: their indices h, k, l and columns.

Nothing here knows of voxels.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.molecules.gemmi_errors import one_line_errors
from volsplat.mapshade_server.readers.reading.extra import library
from volsplat.mapshade_server.readers.reading.gzip_files import GZIP_MAGIC
from volsplat.mapshade_server.readers.reading.opened_file import opened
from volsplat.protocol.text.errors import BadInput

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Columns by the names that refinement programs give them, what one wants to see first before the rest.
PAIRS = (
    ("FWT", "PHWT"),
    ("2FOFCWT", "PH2FOFCWT"),
    ("pdbx_FWT", "pdbx_PHWT"),
    ("FWT", "PHFWT"),
    ("F_meas_au", "phase_meas"),
    ("F_meas", "phase_meas"),
    ("FC", "PHIC"),
    ("F_calc_au", "phase_calc"),
    ("F_calc", "phase_calc"),
    ("DELFWT", "PHDELWT"),
    ("FOFCWT", "PHFOFCWT"),
    ("pdbx_DELFWT", "pdbx_DELPHWT"),
)
MEASURED = ("FP", "F", "FOBS", "F-obs", "F_meas_au", "F_meas")

_MMCIF_AMPLITUDES = ("F_meas_au", "F_meas", "F_calc_au", "F_calc", "pdbx_FWT", "pdbx_DELFWT")
_MMCIF_PHASES = ("phase_meas", "phase_calc", "pdbx_PHWT", "pdbx_DELPHWT")
_MMCIF_INTENSITIES = ("intensity_meas", "F_squared_meas")
_MTZ_HEAD = 20  # bytes before the reflections
_MTZ_STAMPS: dict[int, Literal["<", ">"]] = {4: "<", 1: ">"}
_FLATTEST_CELL = 1e-3  # its volume, of that of a right-angled cell
_LARGEST_INDEX = 1 << 20


@dataclass(frozen=True)
class Reflections:
    """n reflections with what their file knows of each; NaN where it is not known."""

    path: Path
    cell: Any
    space_group: Any
    indices: Integers  # (n, 3): h, k, l
    amplitudes: Mapping[str, Floats]  # by label
    phases: Mapping[str, Floats]  # degrees
    intensities: Mapping[str, Floats]
    warnings: tuple[str, ...] = ()
    block: str = ""  # that was named
    blocks: tuple[str, ...] = ()  # of which nobody named one

    @property
    def pairs(self) -> list[tuple[str, str]]:
        """Amplitudes with the phases that belong to them, those that a map is made of first."""
        known = [pair for pair in PAIRS if pair[0] in self.amplitudes and pair[1] in self.phases]
        labels = [*self.amplitudes, *self.phases]
        alone = len(self.phases) == 1 and len(self.amplitudes) == 1
        return known or ([(labels[0], labels[1])] if alone else [])

    @property
    def columns(self) -> str:
        """What there is, for messages."""
        kinds = (("amplitudes", self.amplitudes), ("phases", self.phases), ("intensities", self.intensities))
        return "; ".join(f"{name} {', '.join(values)}" for name, values in kinds if values) or "no amplitudes"

    def symmetry(self) -> list[tuple[Integers, Floats]]:
        """The space group's operations, without those that only centre the cell: rotation, translation in cells."""
        operations = self.space_group.operations().sym_ops
        return [(np.array(one.rot) // one.DEN, np.array(one.tran) / one.DEN) for one in operations]


def mtz_reflections(path: Path) -> Reflections:
    """The reflections of an MTZ file. Raises BadInput."""
    _check_mtz(path)
    gemmi = library("gemmi", "an MTZ file")
    kinds: dict[str, dict[str, Floats]] = {"F": {}, "P": {}, "J": {}}
    # A damaged number may be a NaN of the kind that warns.
    with one_line_errors(path, "MTZ file"), np.errstate(invalid="ignore"):
        mtz = gemmi.read_mtz_file(str(path))
        table = np.array(mtz, np.float64)
        measured = table[:, 3:]
        measured[measured == mtz.valm] = np.nan  # which is NaN itself in most files
        for number, column in enumerate(mtz.columns):
            if column.type in kinds:
                kinds[column.type][column.label] = table[:, number]
    if len(mtz.batches):
        raise _unmerged(path)
    return _checked(path, mtz.cell, mtz.spacegroup, table[:, :3], kinds["F"], kinds["P"], kinds["J"])


def mmcif_reflections(path: Path, document: Any, wanted: str | None) -> Reflections:
    """The reflections of gemmi's CIF document, of the block that is `wanted` by its name. Raises BadInput."""
    with one_line_errors(path, "mmCIF file"):
        every = library("gemmi", "an mmCIF file").as_refln_blocks(document)
        blocks = {block.block.name: block for block in every if block.default_loop is not None}
    if wanted is not None and wanted not in blocks:
        raise BadInput(f"{path}: has no block {wanted} with reflections; there are {', '.join(blocks) or 'none'}")
    if not blocks:
        raise BadInput(f"{path}: has no list of reflections; give a file with structure factors")
    block = blocks[wanted if wanted is not None else next(iter(blocks))]
    if block.is_unmerged():
        raise _unmerged(path)
    warnings: tuple[str, ...] = ()
    if wanted is None and len(blocks) > 1:
        warnings = (f"of the blocks {', '.join(blocks)} the first is shown; #map,block=NAME shows another",)
    with one_line_errors(path, "mmCIF file"):
        labels = block.column_labels()
        amplitudes, phases, intensities = (
            {label: np.array(block.make_float_array(label)) for label in known if label in labels}
            for known in (_MMCIF_AMPLITUDES, _MMCIF_PHASES, _MMCIF_INTENSITIES)
        )
        indices = np.array(block.make_miller_array(), np.float64)
    found = _checked(path, block.cell, block.spacegroup, indices, amplitudes, phases, intensities, warnings)
    return replace(found, block=wanted or "", blocks=tuple(blocks) if warnings else ())


def _checked(
    path: Path,
    cell: Any,
    space_group: Any,
    indices: Floats,
    amplitudes: dict[str, Floats],
    phases: dict[str, Floats],
    intensities: dict[str, Floats],
    warnings: tuple[str, ...] = (),
) -> Reflections:
    lengths = (cell.a, cell.b, cell.c)
    if not (cell.is_crystal() and min(lengths) > 0 and cell.volume > _FLATTEST_CELL * np.prod(lengths)):
        raise BadInput(f"{path}: states no cell that reflections could come from; correct its header")
    if not (len(indices) and np.isfinite(indices).all() and np.abs(indices).max() < _LARGEST_INDEX):
        raise BadInput(f"{path}: has no reflections, or their indices are no numbers; fetch the file again")
    if space_group is None:
        warnings += ("the file states no space group; P 1 is taken",)
        space_group = library("gemmi", "structure factors").SpaceGroup("P 1")
    whole = np.rint(indices).astype(np.int64)
    return Reflections(path, cell, space_group, whole, amplitudes, phases, intensities, warnings)


def _check_mtz(path: Path) -> None:
    """Raises BadInput if the file cannot hold what its header promises; gemmi would make room for it first."""
    size = path.stat().st_size
    truncated = BadInput(f"{path}: is truncated or its header is wrong, it promises more than the file holds")
    with opened(path) as file:
        head = file.read(_MTZ_HEAD)
        if head.startswith(GZIP_MAGIC):
            raise BadInput(f"{path}: is compressed; unzip it first")
        order = _MTZ_STAMPS.get(head[8] >> 4 if len(head) == _MTZ_HEAD else 0)
        if order is None:
            raise BadInput(f"{path}: is truncated or of a machine that is not known; fetch it again")
        (words,) = struct.unpack_from(f"{order}i", head, 4)
        if words == -1:  # written so if it takes more bits
            (words,) = struct.unpack_from(f"{order}q", head, 12)
        start = 4 * (words - 1)
        if not _MTZ_HEAD <= start < size:
            raise truncated
        file.seek(start)
        while (record := file.read(80)) and not record.startswith(b"NCOL"):
            pass
    try:
        columns, reflections = (int(word) for word in record.split()[1:3])
    except ValueError:
        raise truncated from None
    if columns < 3 or reflections < 0 or 4 * columns * reflections > start - _MTZ_HEAD:
        raise truncated


def _unmerged(path: Path) -> BadInput:
    return BadInput(f"{path}: each reflection is there as often as it was measured; merge them first (aimless does)")
