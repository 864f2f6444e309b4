"""One table as a TOML file: a scene file that holds nothing else, so that a scene reads it as well."""

from __future__ import annotations

import tomllib

from volsplat.client.scene.scene_file import scene_from_toml, toml_value
from volsplat.client.ui.tables.table_edits import Table
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.scene_keys import KEYS, SECTIONS
from volsplat.protocol.description.shading_tables import ColourTable
from volsplat.protocol.text.errors import BadInput


def table_toml(scene: Scene, which: str) -> str:
    """The table `which` ("emit", "refl", "opac" or "modu") of a scene; reading it gives an equal table."""
    key = f"tables.{which}"
    points = f"{key}.points"
    table: Table = getattr(scene.tables, which)
    written = toml_value(table.points, points)
    return "\n".join([*_comment(SECTIONS[key]), f"# {KEYS[points].allowed}", f"[{key}]", f"points = {written}", ""])


def table_from_toml(text: str, base: Scene, which: str, name: str) -> Table:
    """The table for `which` out of a table's or a whole scene's file; `name` stands before every message.

    A file without a table of this name may give its one table of the same kind. Raises BadInput.
    """
    tables = scene_from_toml(text, base, name).tables
    wanted = type(getattr(tables, which))
    given = [key for key in tomllib.loads(text).get("tables", {}) if isinstance(getattr(tables, key), wanted)]
    if which in given:
        given = [which]
    if len(given) != 1:
        kind = "colours" if wanted is ColourTable else "opacities"
        raise BadInput(f"{name}: holds {'no table' if not given else 'more than one table'} of {kind} to take")
    table: Table = getattr(tables, given[0])
    return table


def _comment(text: str) -> list[str]:
    return [f"# {line}" for line in text.splitlines()]
