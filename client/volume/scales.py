"""What lengths in a picture are told in: the volume's unit, or that of each axis of another kind or spacing."""

import math
from collections.abc import Iterable

import msgspec

from volsplat.protocol.description.volume import GridAxis, VolumeDescription

ALIKE = 1e-3  # by how much, as a share, spacings that count as equal differ
VOXELS = "voxels"

# Units of one kind: axes in them are lengths of the volume, if it has one of them as well.
KINDS = (
    frozenset({"deg", "arcmin", "arcsec", "mas", "rad"}),
    frozenset({"pm", "Å", "Angstrom", "nm", "um", "µm", "mm", "cm", "m", "km", "AU", "pc", "kpc", "Mpc"}),
)


class Scale(msgspec.Struct, frozen=True):
    """What a length in the picture is."""

    name: str  # of the axes that it holds for, "" if it holds for all
    unit: str  # "" for what has none
    length: float  # in the volume's physical unit, of one `unit`
    axis: int | None = None  # the grid axis, if it holds for one alone


def scales_of(description: VolumeDescription) -> tuple[Scale, ...]:
    """The scales that a volume needs, at least one."""
    unit, axes, spacing = description.unit, description.axes, description.geometry.spacing
    if axes is None and unit:
        return (Scale("", unit, 1.0),)
    if axes is None:
        if max(spacing) <= min(spacing) * (1 + ALIKE):
            return (Scale("", VOXELS, spacing[0]),)
        return _joined(Scale("ijk"[n], VOXELS, step, n) for n, step in enumerate(spacing))
    lengths = [n for n, axis in enumerate(axes) if unit and _alike(axis.unit, unit)]
    others = _joined(_along(axes[n], spacing[n], n) for n in range(3) if n not in lengths)
    if not lengths:
        return others
    names = ", ".join(axes[n].name for n in lengths) if others else ""
    return (Scale(names, unit, 1.0, lengths[0] if len(lengths) == 1 else None), *others)


def scale_text(scale: Scale, amount: float) -> str:
    """What stands beside a bar of so many units."""
    unit = "voxel" if scale.unit == VOXELS and amount == 1 else scale.unit
    return " ".join(word for word in (scale.name, f"{amount:g}", unit) if word)


def round_length(most: float) -> float:
    """The greatest of 1, 2, 5 times a power of ten that is at most `most`, which is above 0."""
    power = math.floor(math.log10(most))
    candidates = [float(f"{factor}e{power + more}") for more in (-1, 0, 1) for factor in (1, 2, 5)]
    return max(candidate for candidate in candidates if candidate <= most)


def _along(axis: GridAxis, spacing: float, n: int) -> Scale:
    return Scale(axis.name, axis.unit, spacing if axis.step == 0 else spacing / abs(axis.step), n)


def _joined(scales: Iterable[Scale]) -> tuple[Scale, ...]:
    """Those that are alike as one, by all their names."""
    told: list[Scale] = []
    for scale in scales:
        for n, same in enumerate(told):
            if same.unit == scale.unit and abs(scale.length / same.length - 1) < ALIKE:
                told[n] = msgspec.structs.replace(same, name=f"{same.name}, {scale.name}", axis=None)
                break
        else:
            told.append(scale)
    return tuple(told)


def _alike(own: str, unit: str) -> bool:
    """Whether an axis in one unit, "" for what has none, is measured by another."""
    return own in ("", unit) or any(own in kind and unit in kind for kind in KINDS)
