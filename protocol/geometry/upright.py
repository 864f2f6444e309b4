"""Which way is up: a signed physical axis, and the rotation that stands a volume upright.

Upright axes are those that view names, azimuths and elevations are told in: z up, the viewer of the front view at -y, x
to the right of that picture. Up only ever *rotates* the volume into them; nothing is mirrored.
"""

from typing import Literal, get_args

from volsplat.protocol.geometry.matrices import Matrix

Up = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
UPS: tuple[Up, ...] = get_args(Up)

# Each is the shortest turn that brings its axis to z; of the two half turns for -z, the one that leaves y, so that the
# front stays in front.
_UPRIGHT: dict[Up, Matrix] = {
    "+x": ((0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)),
    "-x": ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)),
    "+y": ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)),
    "-y": ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)),
    "+z": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "-z": ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)),
}


def upright(up: Up | Literal["auto"]) -> Matrix:
    """The rotation from physical to upright axes. "auto" is "+z": what else it is, only the volume's client knows."""
    return _UPRIGHT["+z" if up == "auto" else up]
