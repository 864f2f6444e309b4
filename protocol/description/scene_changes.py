"""Changes of a scene as a script writes them: each by the name of its key, which stands for its place."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

import msgspec

from volsplat.protocol.description.colours import Colour, colour_from_text
from volsplat.protocol.description.patches import Patch
from volsplat.protocol.description.python_values import python_value
from volsplat.protocol.description.scene import Bounds, Scene
from volsplat.protocol.description.scene_key import Part
from volsplat.protocol.description.scene_keys import KEYS, SECTIONS, SceneKey
from volsplat.protocol.description.shading_tables import ColourTable, ScalarTable
from volsplat.protocol.description.view_rotation import VIEW_NAMES, Quaternion, named_view, rotation_from_angles
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.meant import meant

_COUNT = Counter(key.name for key in KEYS.values())
_NAMED = {key.name: key for key in KEYS.values() if _COUNT[key.name] == 1}
_TABLES = {"emit": ColourTable, "refl": ColourTable, "opac": ScalarTable, "modu": ScalarTable}


def changed(scene: Scene, changes: Mapping[str, Any]) -> Scene:
    """The scene with all of them. Raises BadInput, naming the first that it cannot have."""
    for name, value in changes.items():
        try:
            scene = _change_of(name)(scene, _plain(value))
        except (msgspec.ValidationError, ValueError, TypeError) as error:
            raise BadInput(f"{name}={value!r:.60}: {' '.join(str(error).split())}{_allowed(name)}") from None
    return scene


def _change_of(name: str) -> Callable[[Scene, Any], Scene]:
    if name in _OWN:
        return _OWN[name]
    if name in _TABLES:
        return lambda scene, value: _put_table(scene, name, value)
    if name in SECTIONS and "." not in name and name:
        return lambda scene, value: _put_section(scene, name, value)
    if name in _NAMED:
        return lambda scene, value: _put_key(scene, _NAMED[name], value)
    known = [*_OWN, *_TABLES, *_NAMED, *(place for place in SECTIONS if place and "." not in place)]
    cure = meant(name, known, f"it has {', '.join(known)}")
    raise BadInput(f"a scene has no {name}; {cure}")


def _put_key(scene: Scene, key: SceneKey, value: Any) -> Scene:
    kind = key.declared.kind
    return key.put(scene, _colour(value) if kind == Colour else msgspec.convert(value, kind))


def _put_section(scene: Scene, name: str, value: Any) -> Scene:
    section = type(getattr(scene, name))
    if not isinstance(value, section):
        raise TypeError(f"is no {section.__name__}")
    replaced: Scene = msgspec.structs.replace(scene, **{name: value})
    return replaced


def _put_table(scene: Scene, name: str, value: Any) -> Scene:
    kind = _TABLES[name]
    if not isinstance(value, Part):
        if kind is ColourTable:
            value = [(position, _colour(colour)) for position, colour in value]
        value = msgspec.convert({"points": value}, kind)
    elif not isinstance(value, kind):
        raise TypeError(f"is no {kind.__name__}")
    return msgspec.structs.replace(scene, tables=msgspec.structs.replace(scene.tables, **{name: value}))


def _put_patches(scene: Scene, value: Any) -> Scene:
    return KEYS["plane.patches"].put(scene, tuple(map(_patch, value)))


def _patch(value: Any) -> Patch:
    if isinstance(value, Patch):
        return value
    coloured = {name: _colour(part) if name in ("emit", "refl") else part for name, part in dict(value).items()}
    return msgspec.convert(coloured, Patch)


def _put_size(scene: Scene, value: Any) -> Scene:
    both = (value, value) if isinstance(value, int | float) else value
    whole = tuple(int(side) if isinstance(side, float) and side.is_integer() else side for side in both)
    width, height = msgspec.convert(whole, tuple[int, int])
    return msgspec.structs.replace(scene, image=msgspec.structs.replace(scene.image, width=width, height=height))


def _put_rotation(scene: Scene, value: Any) -> Scene:
    return KEYS["view.rotation"].put(scene, _rotation(value))


def _put_bounds(scene: Scene, value: Any) -> Scene:
    if not isinstance(value, Bounds):
        low, high = value
        value = msgspec.convert({"low": low, "high": high}, Bounds)
    return msgspec.structs.replace(scene, bounds=value)


def _rotation(value: Any) -> Quaternion:
    if isinstance(value, str):
        if value not in VIEW_NAMES:
            raise ValueError(f"is none of {', '.join(VIEW_NAMES)}")
        return named_view(value)
    numbers = msgspec.convert(value, tuple[float, ...])
    if len(numbers) == 4:
        return (numbers[0], numbers[1], numbers[2], numbers[3])
    if len(numbers) not in (2, 3):
        raise ValueError("needs a quaternion, or azimuth and elevation")
    return rotation_from_angles(*numbers)


def _colour(value: Any) -> Colour:
    return colour_from_text(value) if isinstance(value, str) else msgspec.convert(value, Colour)


def _plain(value: Any) -> Any:
    """As Python's own, also within lists."""
    own = python_value(value)
    return tuple(map(_plain, own)) if isinstance(own, list | tuple) else own


def _allowed(name: str) -> str:
    return f"; allowed: {_NAMED[name].allowed}" if name in _NAMED else _SHORTER.get(name, "")


_OWN: dict[str, Callable[[Scene, Any], Scene]] = {
    "size": _put_size,
    "rotation": _put_rotation,
    "bounds": _put_bounds,
    "patches": _put_patches,
}
_SHORTER = {
    "size": "; allowed: pixels, or (width, height)",
    "bounds": "; allowed: ((i, j, k), (i, j, k)), the first voxel and one past the last",
}
