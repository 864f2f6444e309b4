"""Scenes as TOML files: read strictly over a base scene, written complete and with comments."""

import json
import textwrap
from pathlib import Path
from typing import Any

import msgspec

from volsplat.protocol.description.colours import colour_from_text, hex_of_colour
from volsplat.protocol.description.patches import Patch
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.scene_key import Part, Section, declarations
from volsplat.protocol.description.scene_keys import KEYS, SECTIONS, SceneKey
from volsplat.protocol.text.byte_sizes import bytes_text
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.meant import meant
from volsplat.protocol.text.toml_tables import (
    Complaint,
    complaint_of,
    shown_place,
    shown_value,
    toml_tables,
    value_at,
)

LONGEST_FILE = 4 << 20  # bytes; a scene has some thousands
_COMMENT_WIDTH = 110
_COLOUR_TABLES = ("emit", "refl")


def read_scene_file(path: Path, base: Scene) -> Scene:
    """The scene in a TOML file; what the file leaves out is taken from `base`. Raises BadInput, naming the place."""
    return scene_from_bytes(scene_file_bytes(path), base, str(path))


def scene_file_bytes(path: Path) -> bytes:
    """What a scene file holds, for `scene_from_bytes`. Raises BadInput if it cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(LONGEST_FILE + 1)
    except OSError as error:
        raise BadInput(f"{path}: cannot read the scene: {error.strerror}") from error


def scene_from_bytes(content: bytes, base: Scene, name: str) -> Scene:
    """As read_scene_file, from what the file holds; `name` stands before every message."""
    if len(content) > LONGEST_FILE:
        raise BadInput(f"{name}: not a scene file: it has more than {bytes_text(LONGEST_FILE)}")
    try:
        text = content.decode("utf-8-sig")  # editors on Windows begin a file with a mark
    except UnicodeDecodeError as error:
        raise BadInput(f"{name}: not a scene file: byte {error.start} is not UTF-8 text") from error
    return scene_from_toml(text, base, name)


def scene_from_toml(text: str, base: Scene, name: str) -> Scene:
    """As scene_from_bytes, from TOML text."""
    given = toml_tables(text, name)
    _refuse_unknown_keys(name, given, Scene, "")
    _read_hex_colours(name, given)
    merged = _merged(msgspec.to_builtins(base), given)
    try:
        return msgspec.convert(merged, Scene)
    except msgspec.ValidationError as error:
        raise BadInput(_value_message(name, complaint_of(error), merged)) from error


def scene_toml(scene: Scene, title: str = "A volsplat scene") -> str:
    """The whole scene as TOML that explains itself; reading it gives an equal scene."""
    lines = [f"# {line}".rstrip() for line in _printable(title).splitlines()]
    lines += [
        "#",
        "# Everything that decides the image except the volume. Any key may be left out: it is then chosen from the",
        "# volume, as without a scene file. Intensities and opacities are 0 to 1.",
    ]
    for section, explanation in SECTIONS.items():
        if section:
            lines += ["", *_comment(explanation), f"[{section}]"]
        for key in KEYS.values():
            if key.section == section:
                lines += ["", *_comment(key.meaning)] if key.meaning else []
                default = default_toml(key)
                lines += _comment(f"Allowed: {key.allowed}." + (f" Default: {default}." if default else ""))
                lines.append(f"{key.name} = {toml_value(key.of(scene), key.place)}")
    return "\n".join(lines) + "\n"


def _printable(text: str) -> str:
    return "".join(character if character.isprintable() or character == "\n" else " " for character in text)


def _comment(text: str) -> list[str]:
    return [f"# {line}" for paragraph in text.splitlines() for line in textwrap.wrap(paragraph, _COMMENT_WIDTH)]


def default_toml(key: SceneKey) -> str:
    """The TOML of a key's default, or nothing if the default depends on the volume or is a table."""
    return "" if key.section.startswith("tables") else toml_value(key.declared.default, key.place)


def toml_value(value: Any, key: str) -> str:
    """The value of a scene's key as TOML."""
    if key.endswith(".points"):
        coloured = key.split(".")[1] in _COLOUR_TABLES
        rows = [f"  [{point!r}, {_toml_colour(entry) if coloured else repr(entry)}]," for point, entry in value]
        return "\n".join(["[", *rows, "]"])
    if key == "plane.patches":
        return "\n".join(["[", *(f"  {_toml_patch(patch)}," for patch in value), "]"]) if value else "[]"
    if key == "image.background":
        return _toml_colour(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(str(value))
    if isinstance(value, tuple):
        return "[" + ", ".join(repr(part) for part in value) + "]"
    return repr(value)


def _toml_patch(patch: Patch) -> str:
    """In one line, as TOML wants inline tables."""
    parts = [f"{name} = {toml_value(getattr(patch, name), name)}" for name in ("density", "strength", "top")]
    parts += [f"{name} = {getattr(patch, name)!r}" for name in ("soft", "opacity")]
    parts += [f"{name} = {_toml_colour(getattr(patch, name))}" for name in _COLOUR_TABLES]
    return "{ " + ", ".join(parts) + " }"


def _toml_colour(colour: tuple[float, float, float]) -> str:
    text = hex_of_colour(colour)
    return f'"{text}"' if text else "[" + ", ".join(repr(channel) for channel in colour) + "]"


def _refuse_unknown_keys(name: str, given: dict[str, Any], kind: type[Part], section: str) -> None:
    known = {declared.name: declared for declared in declarations(kind)}
    for key, value in given.items():
        place = f"{section}.{key}" if section else key
        if key not in known:
            raise BadInput(f"{name}: {shown_place(place)}: unknown key; {_suggestion(key, section, list(known))}")
        if isinstance(known[key].key, Section):
            if not isinstance(value, dict):
                raise BadInput(f"{name}: {place}: must be a table of keys, [{place}], not {shown_value(value)}")
            _refuse_unknown_keys(name, value, known[key].kind, place)


def _suggestion(key: str, section: str, known: list[str]) -> str:
    elsewhere = [place for place, known_key in KEYS.items() if known_key.name == key]
    if elsewhere:
        otherwise = f"did you mean {' or '.join(elsewhere)}?"
    else:
        otherwise = f"{'[' + section + ']' if section else 'a scene'} has {', '.join(known)}"
    return meant(key, known, otherwise)


def _read_hex_colours(name: str, given: dict[str, Any]) -> None:
    """Replace "#rrggbb" by numbers, in place, wherever a colour belongs; other values are left for the checks."""

    def read(value: Any, place: str) -> Any:
        if not isinstance(value, str):
            return value
        try:
            return colour_from_text(value)
        except ValueError as error:
            raise BadInput(f"{name}: {place}: {error}") from error

    image = given.get("image", {})
    if "background" in image:
        image["background"] = read(image["background"], "image.background")
    patches = given.get("plane", {}).get("patches")
    for n, patch in enumerate(patches if isinstance(patches, list) else []):
        for table in _COLOUR_TABLES:
            if isinstance(patch, dict) and table in patch:
                patch[table] = read(patch[table], f"plane.patches[{n}].{table}")
    for table in _COLOUR_TABLES:
        points = given.get("tables", {}).get(table, {}).get("points")
        if isinstance(points, list):
            for n, point in enumerate(points):
                if isinstance(point, list) and len(point) == 2:
                    point[1] = read(point[1], f"tables.{table}.points[{n}][1]")


def _merged(base: dict[str, Any], given: dict[str, Any]) -> dict[str, Any]:
    result = dict(base)
    for key, value in given.items():
        result[key] = (
            _merged(base[key], value) if isinstance(value, dict) and isinstance(base.get(key), dict) else value
        )
    return result


def _value_message(name: str, complaint: Complaint, merged: dict[str, Any]) -> str:
    what, place = complaint
    if not place:
        return f"{name}: {what}"
    key = place.partition("[")[0]
    if key == "plane.patches" and " of a patch " in what:
        return f"{name}: {place}: {what}"
    if key in KEYS:
        return f"{name}: {place}: {shown_value(value_at(merged, place))} cannot be used; allowed: {KEYS[key].allowed}"
    # The struct's own check, which opens with the name of the key if it concerns one.
    first = what.partition(" ")[0]
    if f"{place}.{first}" in KEYS:
        return f"{name}: {place}.{first}:{what[len(first) :]}"
    return f"{name}: {place}: {what}"
