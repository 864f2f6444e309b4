"""The tables of docs: the scene, the page and figures, made from what is declared; in tests/:

    python -m support.pages.declared_tables

They stand between "<!-- table: name -->" and "<!-- end -->", so that pages and code cannot drift.
"""

import inspect
from typing import Any, get_args

import msgspec

from support.checkout import ROOT
from support.generated_docs import Parts, remake
from volsplat.client.figure.figure import Figure
from volsplat.client.scene.scene_file import default_toml
from volsplat.client.ui.viewport.viewport_messages import PageMessage, ProcessMessage
from volsplat.protocol.description.scene_key import Key, declarations
from volsplat.protocol.description.scene_keys import KEYS, SECTIONS, SceneKey

PAGES = tuple(ROOT / "docs" / page for page in ("reference/scene.md", "how_it_works/page.md", "howto/figures.md"))


def scene_tables() -> str:
    """A table for each section of the scene."""
    lines = []
    for section, meaning in SECTIONS.items():
        keys = [key for key in KEYS.values() if key.section == section]
        if section:
            lines += [f"## [{section}]", "", _one_line(meaning), ""]
        if keys:
            lines += ["| key | allowed | default | meaning |", "|---|---|---|---|"]
            for key in keys:
                default = default_toml(key)
                cells = (f"`{key.name}`", key.allowed, default and f"`{default}`", key.meaning)
                lines.append(f"| {' | '.join(_one_line(cell) for cell in cells)} |".replace("  ", " "))
            lines.append("")
    return "\n".join(lines[:-1])


def figure_table() -> str:
    """The options of a figure."""
    lines = ["| option | allowed | default | meaning |", "|---|---|---|---|"]
    for declared in declarations(Figure):
        assert isinstance(declared.key, Key)
        key, default = SceneKey(declared.name, declared, declared.key), declared.default
        written = ("`true`" if default else "`false`") if isinstance(default, bool) else f"`{default}`" * bool(default)
        cells = (f"`{key.name}`", key.allowed, written, key.meaning)
        lines.append(f"| {' | '.join(_one_line(cell) for cell in cells)} |".replace("  ", " "))
    return "\n".join(lines)


def message_table(union: Any) -> str:
    """What one side says to the other."""
    lines = ["| message | holds | says |", "|---|---|---|"]
    for kind in get_args(union):
        holds = ", ".join(field.encode_name for field in msgspec.structs.fields(kind))
        lines.append(f"| `{kind.__struct_config__.tag}` | {holds} | {_one_line(inspect.getdoc(kind) or '')} |")
    return "\n".join(lines)


def _one_line(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


TABLES: Parts = {
    "scene": scene_tables,
    "figure": figure_table,
    "page": lambda: message_table(PageMessage),
    "process": lambda: message_table(ProcessMessage),
}


if __name__ == "__main__":
    remake(PAGES, TABLES)
