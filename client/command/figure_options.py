"""What `render` and `movie` take for figures, made from what a figure declares."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import click

from volsplat.client.command.help_page import headed
from volsplat.client.figure.figure import BARE, PRINTED, Figure, figure_with, label_from_text, lengths_from_text
from volsplat.protocol.description.scene_key import Key, declarations
from volsplat.protocol.text.errors import BadInput

Command = TypeVar("Command", bound=Callable[..., Any])

METAVARS = {"title": "TEXT", "labels": "TEXT@I,J,K", "dpi": "PIXELS", "text_size": "POINTS", "ink": "COLOUR"}
PARTS = ("scale_bar", "colour_bar", "sides")

_DECLARED = {declared.name: declared for declared in declarations(Figure)}
_MEANINGS = {name: declared.key.meaning for name, declared in _DECLARED.items() if isinstance(declared.key, Key)}


def _option(name: str) -> Callable[[Command], Command]:
    """A key of the figure as an option."""
    flag, meaning = name.replace("_", "-"), _MEANINGS[name]
    match getattr(Figure(), name):
        case bool() if name == "transparent":
            return click.option("--transparent", is_flag=True, default=None, help=meaning)
        case bool():
            return click.option(f"--{flag}/--no-{flag}", name, default=None, help=meaning)
        case tuple():
            return click.option("--label", name, multiple=True, metavar=METAVARS[name], help=meaning)
    kind = click.FLOAT if float in _DECLARED[name].kinds and name != "ink" else click.STRING
    return click.option(f"--{flag}", name, type=kind, metavar=METAVARS[name], help=meaning)


figure_options = headed(
    "As a figure",
    click.option("--figure", is_flag=True, help="With scale bar, colour bar and sides."),
    # --size sets how it is printed
    *(_option(name) for name in _MEANINGS if name not in PRINTED),
)
"""For commands that write figures; what they are given `figure_of` reads."""


def figure_of(settings: dict[str, Any]) -> Figure | None:
    """What the options ask for, None if for no figure. A --size in cm is the figure's, and taken out of `settings`.

    Raises BadInput.
    """
    changes = {name: settings[name] for name in _MEANINGS if settings.get(name) not in (None, ())}
    if settings["figure"]:
        changes = dict.fromkeys(PARTS, True) | changes
    if "labels" in changes:
        changes["labels"] = tuple(_label(text) for text in changes["labels"])
    if lengths := lengths_from_text(settings["size"] or ""):
        settings["size"] = None
        changes |= zip(PRINTED, lengths, strict=False)  # the first may stand alone
    if not changes:
        return None
    return figure_with(BARE, changes)


def _label(text: str) -> tuple[str, tuple[float, float, float]]:
    try:
        return label_from_text(text)
    except ValueError as error:
        raise BadInput(f"--label {text}: give TEXT@I,J,K, as in nose@128,8,60, where I,J,K is a voxel") from error
