"""Structure factors as volumes: MTZ (.mtz) and structure-factor mmCIF (.cif, .ent), through gemmi.

After `#` stands what to make of them, after a colon of which columns, as in data.mtz#map:FWT,PHWT

map          the density that amplitudes and phases transform to, once over the whole cell
patterson    the transform of the squared amplitudes, which needs no phases
amplitude    the amplitudes themselves, in the three dimensions of frequency h, k, l
frequency    likewise, with the phases as second scalar: "The points were colored by phase angle and the opacity
             depends the intensity" (Westover 1989, colour plate 3)

If nothing is said it is the map, if there are phases. Symmetry and Friedel's law fill in what was not measured
again; what was not measured at all is no data.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.molecules.map_kinds import kind_of_names
from volsplat.mapshade_server.readers.molecules.reflections import (
    MEASURED,
    Floats,
    Integers,
    Reflections,
    mmcif_reflections,
    mtz_reflections,
)
from volsplat.mapshade_server.readers.reading.extra import library
from volsplat.mapshade_server.readers.reading.grids import checked_geometry
from volsplat.mapshade_server.readers.reading.part_options import part_options
from volsplat.mapshade_server.readers.reading.parts import Part, PartNeeded
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume, VolumeFormat, Voxels, boxes_of
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.volume import GridAxis, Index, VolumeDescription
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix, Vector
from volsplat.protocol.text.errors import BadInput

KINDS = ("map", "patterson", "amplitude", "frequency")
PHASES = (0.0, 360.0)  # degrees
FINENESS = 4.0  # grid points in the least distance that the reflections resolve; 2 are needed
MOST_VOXELS = 1 << 28
GREATEST_AMPLITUDE = 1e25  # so that sums stay within float32


def open_mtz(path: Path, part: str) -> OpenedVolume:
    """The reader for an MTZ file. Raises BadInput."""
    word, _ = part_options(part, ())
    return open_reflections(mtz_reflections(path), "MTZ", word)


def open_mmcif_reflections(path: Path, part: str, document: Any) -> OpenedVolume:
    """The reader for the reflections in gemmi's CIF document. Raises BadInput."""
    word, options = part_options(part, ("block",))
    reflections = mmcif_reflections(path, document, options.get("block"))
    return open_reflections(reflections, "structure-factor mmCIF", word)


@dataclass(frozen=True)
class _Factors:
    """The structure factors that a volume is made of, and what it says of them."""

    reflections: Reflections
    made_from: str  # the labels of the columns
    made_of: str
    indices: Integers
    amplitudes: Floats
    phases: Floats  # degrees
    warnings: tuple[str, ...]

    def expanded(self) -> "_Factors":
        """With those that symmetry and Friedel's law give too: F(hR) = F(h) exp(-2πi h·t), F(-h) = F*(h)."""
        every, phases = [], []
        for rotation, translation in self.reflections.symmetry():
            copies = self.indices @ rotation
            shifted = self.phases - PHASES[1] * (self.indices @ translation)
            every += [copies, -copies]
            phases += [shifted, -shifted]
        return replace(
            self,
            indices=np.concatenate(every),
            amplitudes=np.tile(self.amplitudes, len(every)),
            phases=np.concatenate(phases) % PHASES[1],
        )


def open_reflections(reflections: Reflections, name: str, word: str) -> OpenedVolume:
    """The reader for what `word` says to make of the reflections of a file in the format `name`. Raises BadInput."""
    kind, _, labels = word.partition(":")
    path = reflections.path
    parts = [] if word else parts_of_reflections(reflections)
    if not kind and not reflections.phases:
        line = (
            f"{path}: {reflections.columns}; without phases there is no density map, but {path}#patterson shows their "
            f"Patterson function and {path}#amplitude the amplitudes in the dimensions of frequency"
        )
        raise PartNeeded(line, parts) if parts else BadInput(line)
    kind = kind or KINDS[0]
    if kind not in KINDS:
        raise BadInput(f"{path}: has no part “{word}”; it is one of {', '.join(KINDS)}, as in {path}#map")
    warnings = list(reflections.warnings)
    if kind in ("map", "frequency"):
        label, indices, amplitudes, phases = _with_phases(reflections, kind, labels, parts)
    else:
        label, indices, amplitudes = _amplitudes(reflections, kind, labels, warnings)
        phases = np.zeros_like(amplitudes)
    made_of = f"{name}, {len(indices)} reflections, {kind} of {label}"
    factors = _Factors(reflections, label, made_of, indices, amplitudes, phases, tuple(warnings))
    if kind == "map":
        named, _ = kind_of_names([label])
        shown = Kind.DIFFERENCE_MAP if named == Kind.DIFFERENCE_MAP else Kind.CRYSTAL_MAP
        return _map(factors, "density", reflections.space_group, shown, parts)
    if kind == "patterson":
        whole = factors.expanded()
        squares = replace(whole, amplitudes=whole.amplitudes**2, phases=np.zeros_like(whole.phases))
        return _map(squares, "Patterson function", library("gemmi", name).SpaceGroup("P 1"), Kind.PATTERSON, parts)
    return _frequency(factors.expanded(), parts, with_phases=kind == "frequency")


def parts_of_reflections(reflections: Reflections) -> list[Part]:
    """What can be made of them, of each pair of columns that belong together, and of each column by itself."""
    if reflections.blocks:  # which of them comes first
        return [Part(f"block={name}", "a list of reflections") for name in reflections.blocks]
    likely = reflections.pairs or itertools.product(reflections.amplitudes, reflections.phases)
    pairs = [",".join(pair) for pair in likely]
    alone = [*reflections.amplitudes, *reflections.intensities]
    told = [
        *(Part(f"map:{pair}", "the density that they transform to") for pair in pairs),
        *(Part(f"patterson:{label}", "the Patterson function, which needs no phases") for label in alone),
        *(Part(f"frequency:{pair}", "in the dimensions of frequency, with phases") for pair in pairs),
        *(Part(f"amplitude:{label}", "in the dimensions of frequency") for label in alone),
    ]
    return [one._replace(part=f"{one.part},block={reflections.block}") if reflections.block else one for one in told]


def _with_phases(
    reflections: Reflections, kind: str, labels: str, parts: Sequence[Part]
) -> tuple[str, Integers, Floats, Floats]:
    """The columns that are asked for, without the reflections that lack a value."""
    path, pairs = reflections.path, reflections.pairs
    words = [word.strip() for word in labels.split(",")] if labels else list(pairs[0]) if pairs else []
    if len(words) != 2 or words[0] not in reflections.amplitudes or words[1] not in reflections.phases:
        example = ",".join(pairs[0] if pairs else [*reflections.amplitudes, "F"][:1] + [*reflections.phases, "PHI"][:1])
        asked = f"“{labels}” is no pair of them" if labels else "which belong together is not known"
        line = f"{path}: {reflections.columns}; {asked}: name an amplitude and its phase, as in {path}#{kind}:{example}"
        raise PartNeeded(line, parts) if parts else BadInput(line)
    amplitudes, phases = reflections.amplitudes[words[0]], reflections.phases[words[1]]
    there = _there(reflections, np.isfinite(amplitudes) & np.isfinite(phases))
    return ",".join(words), reflections.indices[there], amplitudes[there], phases[there]


def _amplitudes(reflections: Reflections, kind: str, label: str, warnings: list[str]) -> tuple[str, Integers, Floats]:
    """The amplitudes that are asked for, or the measured ones; the roots of intensities if there are no others."""
    known = {**reflections.amplitudes, **reflections.intensities}
    chosen = label or next((name for name in (*MEASURED, *known) if name in known), "")
    if chosen not in known:
        asked = f"“{label}” is none of them; " if label else ""
        raise BadInput(
            f"{reflections.path}: {reflections.columns}; {asked}name a column, as in {reflections.path}#{kind}:FP"
        )
    values = known[chosen]
    if chosen in reflections.intensities:
        if negative := int((values < 0).sum()):
            warnings.append(f"{negative} intensities below 0 are taken as 0")
        values = np.sqrt(np.maximum(values, 0.0))
    there = _there(reflections, np.isfinite(values))
    return chosen, reflections.indices[there], values[there]


def _there(reflections: Reflections, there: NDArray[np.bool_]) -> NDArray[np.bool_]:
    if not there.any():
        raise BadInput(f"{reflections.path}: none of its reflections has a value in the columns asked for")
    return there


def _map(factors: _Factors, density_name: str, space_group: Any, kind: Kind, parts: Sequence[Part]) -> OpenedVolume:
    path, cell = factors.reflections.path, factors.reflections.cell
    if not (greatest := float(np.abs(factors.amplitudes).max())) < GREATEST_AMPLITUDE:
        raise BadInput(
            f"{path}: its amplitudes reach {greatest:g}, too far for a map; the file is damaged or scaled wrong"
        )
    waves = (factors.amplitudes * np.exp(1j * np.radians(factors.phases))).astype(np.complex64)
    indices = factors.indices.astype(np.int32)
    transform = library("gemmi", "structure factors").ComplexAsuData(cell, space_group, indices, waves)
    size = transform.get_size_for_hkl(sample_rate=FINENESS)
    dims = _checked_size(path, (size[0], size[1], size[2]))
    to_physical: Matrix = cell.orth.mat.tolist()
    i, j, k = (matrices.scaled(matrices.column(to_physical, axis), 1.0 / dims[axis]) for axis in range(3))
    description = VolumeDescription(
        name=path.name,
        format=f"{factors.made_of} to {transform.make_d_array().min():.3g} Å",
        geometry=checked_geometry(path, dims, matrices.transposed((i, j, k))),
        scalar_type="float32",
        unit="Å",
        kind=kind,
        kind_from=f"it is made of {factors.made_from}",
        density_name=density_name,
        warnings=factors.warnings,
        up="+z",
        reads_sub_cubes=False,
        why_whole="every voxel is a sum over all reflections",
    )
    read = boxes_of(lambda: np.array(transform.transform_f_phi_to_map(exact_size=dims)).T)
    return OpenedVolume(description, read, parts=parts)


def _frequency(factors: _Factors, parts: Sequence[Part], with_phases: bool) -> OpenedVolume:
    path = factors.reflections.path
    reach = [int(most) for most in np.abs(factors.indices).max(axis=0)]
    dims = _checked_size(path, (2 * reach[0] + 1, 2 * reach[1] + 1, 2 * reach[2] + 1))
    to_cells: Matrix = factors.reflections.cell.frac.mat.tolist()
    matrix = matrices.transposed(to_cells)  # its columns are the axes of the reciprocal cell
    middle: Vector = (float(reach[0]), float(reach[1]), float(reach[2]))
    origin = matrices.scaled(matrices.applied(matrix, middle), -1.0)
    h, k, l = (  # noqa: E741 - its name everywhere
        GridAxis(name=name, unit="", first=-most, step=1.0) for name, most in zip("hkl", middle, strict=True)
    )
    description = VolumeDescription(
        name=path.name,
        format=factors.made_of,
        geometry=checked_geometry(path, dims, matrix, origin),
        scalar_type="float32",
        unit="1/Å",
        axes=(h, k, l),
        kind=Kind.STRUCTURE_FACTORS,
        kind_from=f"it is made of {factors.made_from}",
        density_name="amplitude",
        strength_name="phase" if with_phases else "gradient strength",
        second_scalar=PHASES if with_phases else None,
        warnings=factors.warnings,
        up="+z",
        reads_sub_cubes=False,
        why_whole="the list of reflections is read whole",
    )
    read = boxes_of(lambda: _at_indices(dims, factors.indices, factors.amplitudes))
    phases = boxes_of(lambda: _at_indices(dims, factors.indices, factors.phases)) if with_phases else None
    return OpenedVolume(description, read, read_second=phases, parts=parts)


def _checked_size(path: Path, dims: Index) -> Index:
    if dims[0] * dims[1] * dims[2] > MOST_VOXELS:
        shown = " x ".join(map(str, dims))
        raise BadInput(
            f"{path}: its cell and indices ask for {shown} voxels, more than {MOST_VOXELS}; "
            "check them, or leave out the reflections of highest resolution"
        )
    return dims


def _at_indices(dims: Index, indices: Integers, values: Floats) -> Voxels:
    """float32 (k, j, i): NaN where there is no reflection."""
    volume = np.full(dims[::-1], np.nan, np.float32)
    h, k, l = (indices[:, axis] + dims[axis] // 2 for axis in range(3))  # noqa: E741 - its name everywhere
    volume[l, k, h] = values
    return volume


FORMATS = (VolumeFormat("MTZ structure factors (.mtz)", open_mtz, lambda head: head.startswith(b"MTZ "), gzip=True),)
