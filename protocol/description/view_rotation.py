"""The ways to name a view: quaternion, azimuth and elevation, or a side of the volume.

All are told in upright axes (protocol/geometry/upright.py): the physical ones, turned so that what is up in the volume
is z. Of a patient they are LPS: x to the left, y to posterior, z to superior. Every view starts from the front: the
viewer at -y, +z up, +x (the patient's left) on the right of the screen.
"""

import math

from volsplat.protocol.text.errors import BadInput

Quaternion = tuple[float, float, float, float]  # x, y, z, w

_FRONT: Quaternion = (-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))

# Azimuth, elevation and roll in degrees.
_NAMED_ANGLES = {
    "front": (0.0, 0.0, 0.0),
    "back": (180.0, 0.0, 0.0),
    "left": (-90.0, 0.0, 0.0),  # the viewer at +x
    "right": (90.0, 0.0, 0.0),  # the viewer at -x
    "top": (180.0, 90.0, 0.0),  # the viewer at +z, anterior (-y) up
    "bottom": (0.0, -90.0, 0.0),  # the viewer at -z, anterior (-y) up: the radiologist's axial view
}
VIEW_NAMES = tuple(_NAMED_ANGLES)


def named_view(name: str) -> Quaternion:
    """The rotation of one of VIEW_NAMES."""
    return rotation_from_angles(*_NAMED_ANGLES[name])


def rotation_from_angles(azimuth: float, elevation: float, roll: float = 0.0) -> Quaternion:
    """The rotation from upright to screen axes, by degrees from the front view.

    Azimuth turns the volume about the upright +z axis, counter-clockwise as seen from above; elevation then tips
    its top towards the viewer; roll turns the picture counter-clockwise.
    """
    turned = product(_FRONT, about(2, azimuth))
    tipped = product(about(0, elevation), turned)
    return product(about(2, roll), tipped)


def rotation_from_option(text: str) -> Quaternion:
    """The rotation of the option --rotate: "x,y,z,w", "azimuth,elevation[,roll]" in degrees, or a view's name.

    A quaternion is returned as given, in any length but zero. Raises BadInput.
    """
    name = text.strip().lower()
    if name in _NAMED_ANGLES:
        return named_view(name)
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3, 4) or not all(math.isfinite(number) for number in numbers):
        raise BadInput(
            f"--rotate {text}: give a quaternion x,y,z,w, or azimuth,elevation[,roll] in degrees, or one of "
            + ", ".join(VIEW_NAMES)
        )
    if len(numbers) == 4:
        if not any(numbers):
            raise BadInput(f"--rotate {text}: a quaternion of all zeros is no rotation; the identity is 0,0,0,1")
        return (numbers[0], numbers[1], numbers[2], numbers[3])
    return rotation_from_angles(*numbers)


def about(axis: int, degrees: float) -> Quaternion:
    """The turn about a coordinate axis; whole half turns are exact."""
    turn = math.remainder(degrees, 720.0)
    if abs(turn) == 180.0:
        sine, cosine = math.copysign(1.0, turn), 0.0
    else:
        sine, cosine = math.sin(math.radians(turn / 2)), math.cos(math.radians(turn / 2))
    parts = [0.0, 0.0, 0.0]
    parts[axis] = sine
    return (parts[0], parts[1], parts[2], cosine)


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Hamilton's product: b is applied first."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )
