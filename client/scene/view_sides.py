"""What lies on each side of a volume that stands upright: a side of a patient, or an end of an axis.

That is the file's own axis where it names them (right ascension, inline, time), else a physical one.
"""

from typing import Literal, NamedTuple

from volsplat.protocol.description.volume import VolumeDescription
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.geometry.upright import Up, upright

# Where the viewer of each named view stands, in upright axes.
STANDPOINTS: dict[str, Vector] = {
    "front": (0.0, -1.0, 0.0),
    "back": (0.0, 1.0, 0.0),
    "left": (1.0, 0.0, 0.0),
    "right": (-1.0, 0.0, 0.0),
    "top": (0.0, 0.0, 1.0),
    "bottom": (0.0, 0.0, -1.0),
}
_SIGNS = {"+": "+", "-": "−"}
_SHORT = {"crossline": "XL", "inline": "IL", "velocity": "vel", "frequency": "freq", "wavelength": "λ"}
_MARK_LETTERS = 4  # of names that have no short form of their own


class Side(NamedTuple):
    mark: str  # a few letters
    words: str


_PATIENT_SIDES = {
    "+x": Side("L", "the patient's left"),
    "-x": Side("R", "the patient's right"),
    "+y": Side("P", "posterior"),
    "-y": Side("A", "anterior"),
    "+z": Side("S", "superior"),
    "-z": Side("I", "inferior"),
}


def sides(description: VolumeDescription, up: Up | Literal["auto"]) -> dict[str, Side]:
    """By the names of views."""
    to_physical = matrices.transposed(upright(up))
    ends = _PATIENT_SIDES if description.anatomical else _ends(description)
    told = {}
    for name, standpoint in STANDPOINTS.items():
        towards = matrices.applied(to_physical, standpoint)
        axis = max(range(3), key=lambda n: abs(towards[n]))
        told[name] = ends[("+" if towards[axis] > 0 else "-") + "xyz"[axis]]
    return told


def _ends(description: VolumeDescription) -> dict[str, Side]:
    """By the ends of physical axes."""
    if description.axes is None:
        return {sign + axis: Side(_SIGNS[sign] + axis, sign + axis) for axis in "xyz" for sign in "+-"}
    ends = {}
    steps = [matrices.normalised(matrices.column(description.geometry.index_to_physical, n)) for n in range(3)]
    for n, physical in enumerate(matrices.nearest_axes(steps)):
        axis = description.axes[n]
        rises = steps[n][physical] * axis.step > 0
        short = _SHORT.get(axis.name, axis.name[:_MARK_LETTERS])
        for sign in "+-":
            greater = rises == (sign == "+")
            words = f"{'greater' if greater else 'smaller'} {axis.name}"
            ends[sign + "xyz"[physical]] = Side(short + _SIGNS["+" if greater else "-"], words)
    return ends
