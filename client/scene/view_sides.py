"""What lies on each side of a volume that stands upright: an end of a physical axis, or a side of a patient."""

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
_PATIENT = {
    "+x": ("L", "the patient's left"),
    "-x": ("R", "the patient's right"),
    "+y": ("P", "posterior"),
    "-y": ("A", "anterior"),
    "+z": ("S", "superior"),
    "-z": ("I", "inferior"),
}


class Side(NamedTuple):
    mark: str  # a letter or two
    words: str


def sides(description: VolumeDescription, up: Up | Literal["auto"]) -> dict[str, Side]:
    """By the names of views."""
    to_physical = matrices.transposed(upright(up))
    told = {}
    for name, standpoint in STANDPOINTS.items():
        towards = matrices.applied(to_physical, standpoint)
        axis = max(range(3), key=lambda n: abs(towards[n]))
        end = ("+" if towards[axis] > 0 else "-") + "xyz"[axis]
        told[name] = Side(*_PATIENT[end]) if description.anatomical else Side(end.replace("-", "−"), end)
    return told
