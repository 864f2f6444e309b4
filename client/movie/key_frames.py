"""The scenes of a movie: once around one scene, or from key scene to key scene. Pure: nothing is drawn here."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Literal

import msgspec

from volsplat.client.movie.table_windows import Window, in_window
from volsplat.protocol.description.colours import Colour
from volsplat.protocol.description.patches import Patch, Plane
from volsplat.protocol.description.scene import Bounds, Light, Scene, View
from volsplat.protocol.description.shading_tables import ColourTable, ScalarTable, Tables
from volsplat.protocol.description.view_rotation import Quaternion, product
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.geometry.upright import Up, upright
from volsplat.protocol.rules.resolved_view import resolved_bounds, resolved_center, resolved_zoom
from volsplat.protocol.text.errors import BadInput

TurningAxis = Literal["screen-x", "screen-y", "screen-z", "grid-i", "grid-j", "grid-k"]

_SAME_DIRECTION = 1e-6  # radians; below it a straight line is as good as an arc
_LIGHT_AMOUNTS = ("shadows", "occlusion", "depth_cue", "silhouettes")
_OPPOSITE = 1e-6  # the length of a sum of two unit vectors, below which it has no direction


def turntable(scene: Scene, geometry: Geometry, frames: int, axis: TurningAxis = "screen-y") -> list[Scene]:
    """`frames` scenes once around, counter-clockwise as seen from the axis' tip; the first is `scene` as it is.

    The volume turns about the grid point at the image's centre. The last scene is one turn's part short of the
    first, so that the movie can be looped.
    """
    return [_turned(scene, geometry, axis, Fraction(n, frames)) for n in range(frames)]


def key_framed(keys: Sequence[Scene], geometry: Geometry, frames: int, automatic: Window = (0.0, 1.0)) -> list[Scene]:
    """`frames` scenes that pass through the keys at even distances in time; the ends are the first and last key.

    Rotation goes the shortest way at an even rate, zoom by even factors, centre, bounds, light direction and the
    points of tables and patches that are equally many go in straight lines; all else is the earlier key's until the
    later one is reached. Tables of another window, of which `automatic` is that of scenes that set none, are compared
    by the densities that they are for; patches then are the earlier key's. Raises BadInput if that cannot be.
    """
    check_key_count(len(keys), frames)
    places = [Fraction(n * (len(keys) - 1), frames - 1) for n in range(frames)]
    try:
        return [_at(keys, geometry, place, automatic) for place in places]
    except ValueError as error:
        raise BadInput(f"no scene lies between these keys: {error}") from error


def check_key_count(keys: int, frames: int) -> None:
    """Raise BadInput if so many frames cannot pass through so many keys."""
    if not 2 <= keys <= frames:
        scenes = "1 key scene" if keys == 1 else f"{keys} key scenes"
        raise BadInput(f"{frames} frames cannot pass through {scenes}; give 2 keys or more, and as many frames")


def _turned(scene: Scene, geometry: Geometry, axis: TurningAxis, turn: Fraction) -> Scene:
    if turn == 0:
        return scene
    rotation = _unit(scene.view.rotation)
    frame, _, name = axis.partition("-")
    if frame == "screen":
        unit: Vector = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))["xyz".index(name)]
        turned = product(_about(unit, turn), rotation)
    else:
        along = matrices.column(geometry.index_to_physical, "ijk".index(name))
        unit = matrices.normalised(matrices.applied(upright(scene.view.up), along))
        turned = product(rotation, _about(unit, turn))
    view = msgspec.structs.replace(scene.view, rotation=_unit(turned))
    return msgspec.structs.replace(scene, view=view)


def _at(keys: Sequence[Scene], geometry: Geometry, place: Fraction, automatic: Window) -> Scene:
    """The scene at a place that counts keys: 3/2 is halfway from the second to the third."""
    earlier, part = int(place), place % 1
    if part == 0:
        return keys[earlier]
    a, b = keys[earlier], keys[earlier + 1]
    window, other = (automatic if key.quantise.window == "auto" else key.quantise.window for key in (a, b))
    if window != other:
        b = msgspec.structs.replace(in_window(b, other, window), plane=a.plane)
    return msgspec.structs.replace(
        a,
        tables=_tables_between(a.tables, b.tables, float(part)),
        plane=_plane_between(a.plane, b.plane, float(part)),
        light=_light_between(a.light, b.light, float(part)),
        view=_view_between(a, b, geometry, float(part)),
        bounds=_bounds_between(a, b, geometry, part),
    )


def _view_between(a: Scene, b: Scene, geometry: Geometry, part: float) -> View:
    """Where both keys leave zoom or centre to the volume, so does what lies between them; up is the first key's."""
    zoom = a.view.zoom
    if zoom != b.view.zoom:
        first, second = resolved_zoom(a, geometry), resolved_zoom(b, geometry)
        zoom = min(max(first * (second / first) ** part, min(first, second)), max(first, second))
    center = a.view.center
    if center != b.view.center:
        center = _vector_between(resolved_center(a, geometry), resolved_center(b, geometry), part)
    second_rotation = product(b.view.rotation, _from_up_to_up(a.view.up, b.view.up))
    rotation = rotation_between(a.view.rotation, second_rotation, part)
    return View(rotation=rotation, up=a.view.up, zoom=zoom, center=center)


def _from_up_to_up(a: Up | Literal["auto"], b: Up | Literal["auto"]) -> Quaternion:
    """The turn from the axes that are upright by `a` to those by `b`."""
    if a == b:
        return (0.0, 0.0, 0.0, 1.0)
    return matrices.quaternion_from_rotation(matrices.product(upright(b), matrices.transposed(upright(a))))


def rotation_between(a: Quaternion, b: Quaternion, part: float) -> Quaternion:
    """The unit quaternion at `part` (0..1) of the shortest turn from `a` to `b`, at an even rate."""
    first, second = _unit(a), _unit(b)
    if sum(p * q for p, q in zip(first, second, strict=True)) < 0:  # -q is the same rotation as q
        second = (-second[0], -second[1], -second[2], -second[3])
    apart = math.hypot(*(p - q for p, q in zip(first, second, strict=True)))
    together = math.hypot(*(p + q for p, q in zip(first, second, strict=True)))
    angle = 2 * math.atan2(apart, together)  # exact for small angles, where an arc cosine is not
    if angle < _SAME_DIRECTION:
        weights = (1 - part, part)
    else:
        weights = (math.sin((1 - part) * angle) / math.sin(angle), math.sin(part * angle) / math.sin(angle))
    x, y, z, w = (weights[0] * p + weights[1] * q for p, q in zip(first, second, strict=True))
    return _unit((x, y, z, w))


def _bounds_between(a: Scene, b: Scene, geometry: Geometry, part: Fraction) -> Bounds:
    """Whole voxels; exact numbers, so that no rounding makes an empty range of two that are not."""
    if a.bounds == b.bounds:
        return a.bounds
    first, second = resolved_bounds(a, geometry), resolved_bounds(b, geometry)

    def between(p: Index, q: Index) -> Index:
        i, j, k = (math.floor(m + (n - m) * part + Fraction(1, 2)) for m, n in zip(p, q, strict=True))
        return (i, j, k)

    return Bounds(low=between(first.low, second.low), high=between(first.high, second.high))


def _light_between(a: Light, b: Light, part: float) -> Light:
    amounts = {name: _between(getattr(a, name), getattr(b, name), part) for name in _LIGHT_AMOUNTS}
    light = msgspec.structs.replace(a, **amounts)
    if a.fixed_to != b.fixed_to or a.direction == b.direction:
        return light
    direction = _vector_between(matrices.normalised(a.direction), matrices.normalised(b.direction), part)
    if matrices.length(direction) < _OPPOSITE:  # halfway between opposite directions
        return light
    return msgspec.structs.replace(light, direction=direction)


def _tables_between(a: Tables, b: Tables, part: float) -> Tables:
    return Tables(
        emit=_colours_between(a.emit, b.emit, part),
        refl=_colours_between(a.refl, b.refl, part),
        opac=_scalars_between(a.opac, b.opac, part),
        modu=_scalars_between(a.modu, b.modu, part),
    )


def _plane_between(a: Plane, b: Plane, part: float) -> Plane:
    if a == b or len(a.patches) != len(b.patches):
        return a
    return Plane(patches=tuple(_patch_between(p, q, part) for p, q in zip(a.patches, b.patches, strict=True)))


def _patch_between(a: Patch, b: Patch, part: float) -> Patch:
    top = a.top if a.top == b.top else _ends_between(a.ends[1], b.ends[1], part)
    return Patch(
        density=_ends_between(a.density, b.density, part),
        strength=_ends_between(a.strength, b.strength, part),
        top=top,
        soft=_between(a.soft, b.soft, part),
        opacity=_between(a.opacity, b.opacity, part),
        emit=_vector_between(a.emit, b.emit, part),
        refl=_vector_between(a.refl, b.refl, part),
    )


def _ends_between(a: tuple[float, float], b: tuple[float, float], part: float) -> tuple[float, float]:
    return _between(a[0], b[0], part), _between(a[1], b[1], part)


def _colours_between(a: ColourTable, b: ColourTable, part: float) -> ColourTable:
    if a == b or len(a.points) != len(b.points):
        return a
    pairs = zip(a.points, b.points, strict=True)
    return ColourTable(points=tuple((_between(p, q, part), _vector_between(c, d, part)) for (p, c), (q, d) in pairs))


def _scalars_between(a: ScalarTable, b: ScalarTable, part: float) -> ScalarTable:
    if a == b or len(a.points) != len(b.points):
        return a
    pairs = zip(a.points, b.points, strict=True)
    return ScalarTable(points=tuple((_between(p, q, part), _between(v, w, part)) for (p, v), (q, w) in pairs))


def _vector_between(a: Vector | Colour, b: Vector | Colour, part: float) -> Vector:
    return (_between(a[0], b[0], part), _between(a[1], b[1], part), _between(a[2], b[2], part))


def _between(a: float, b: float, part: float) -> float:
    """Rises with `a` and with `b` even when rounded: positions stay in order, and what is at most 1 stays so."""
    return a * (1 - part) + b * part


def _about(unit: Vector, turn: Fraction) -> Quaternion:
    """Part of a whole turn about a unit vector."""
    half_angle = math.pi * float(turn)
    x, y, z = matrices.scaled(unit, math.sin(half_angle))
    return (x, y, z, math.cos(half_angle))


def _unit(q: Quaternion) -> Quaternion:
    largest = max(abs(part) for part in q)
    x, y, z, w = (part / largest for part in q)  # their squares neither vanish nor overflow
    size = math.sqrt(x * x + y * y + z * z + w * w)
    return (x / size, y / size, z / size, w / size)
