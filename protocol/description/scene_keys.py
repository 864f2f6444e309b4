"""The scene's keys and sections by their place, made from what the scene declares (protocol/description/scene.py)."""

from collections.abc import Iterator
from enum import EnumType
from functools import reduce
from typing import Any, NamedTuple

import msgspec

from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.scene_key import Declared, Key, Part, Section, Widget, declarations
from volsplat.protocol.description.shading_tables import Tables


class SceneKey(NamedTuple):
    """A key at its place, as in "view.zoom"."""

    place: str
    declared: Declared
    told: Key

    @property
    def section(self) -> str:
        return self.place.rpartition(".")[0]

    @property
    def name(self) -> str:
        return self.declared.name

    @property
    def meaning(self) -> str:
        return self.told.meaning

    @property
    def widget(self) -> Widget:
        return self.told.widget

    @property
    def allowed(self) -> str:
        """What may stand there, with its unit; also shown when a value is refused."""
        if self.told.allowed:
            return self.told.allowed
        kind, words = self.declared.kind, [f'"{word}"' for word in self.declared.words]
        if kind is bool:
            return "true or false"
        if self.told.limits is None:
            return " or ".join(words) if len(words) < 3 else f"one of {', '.join(words)}"
        numbers = f"{self.told.limits.words(', ')} {self.told.unit}".rstrip()
        return ", or ".join([numbers, *words])

    @property
    def values(self) -> tuple[Any, ...]:
        """All that may stand there, of a key that is a choice."""
        kind = self.declared.kind
        return tuple(kind) if isinstance(kind, EnumType) else self.declared.words

    def of(self, scene: Scene) -> Any:
        """Its value in a scene."""
        return reduce(getattr, self.place.split("."), scene)

    def put(self, scene: Scene, value: Any) -> Scene:
        """The scene with another value. Raises ValueError."""
        changed: Scene = _put(scene, self.place.split("."), value)
        return changed


def _put(part: Any, place: list[str], value: Any) -> Any:
    first, *rest = place
    return msgspec.structs.replace(part, **{first: _put(getattr(part, first), rest, value) if rest else value})


def _walked(part: type[Part], section: str = "") -> Iterator[tuple[str, Declared]]:
    """Keys before sections, as TOML has them."""
    for declared in sorted(declarations(part), key=lambda declared: isinstance(declared.key, Section)):
        place = f"{section}.{declared.name}".removeprefix(".")
        yield place, declared
        if isinstance(declared.key, Section):
            yield from _walked(declared.kind, place)


_ALL = dict(_walked(Scene))

# In the order of the file; "" is its top.
SECTIONS: dict[str, str] = {"": ""} | {
    place: declared.key.meaning for place, declared in _ALL.items() if isinstance(declared.key, Section)
}
KEYS: dict[str, SceneKey] = {
    place: SceneKey(place, declared, declared.key) for place, declared in _ALL.items() if isinstance(declared.key, Key)
}

TABLES: dict[str, str] = {
    declared.name: declared.key.title for declared in declarations(Tables) if isinstance(declared.key, Section)
}
"""What a person calls each table, by its name in the scene."""
TABLE_WORDS = {table: called.split()[0].capitalize() for table, called in TABLES.items()}
"""The same in one word."""


def why_unused(table: str, scene: Scene) -> str:
    """Why a table changes nothing under the switches of the shading rules; "" if it does."""
    if scene.plane.patches:
        return "the 2-D table takes its place"
    shading = scene.shading
    why = {
        "emit": "" if shading.emitted else "emitted light is off",
        "refl": "" if shading.diffuse or shading.specular else "reflected light is off",
        "modu": "" if shading.modulation else "modulation is off",
    }
    return why.get(table, "")
