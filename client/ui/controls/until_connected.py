"""Panels that take nothing before the process hears of it."""

from __future__ import annotations

from nicegui import context, ui

INERT = "inert"  # HTML's own word: neither pointer nor keys reach what is within


def until_connected(*panels: ui.element) -> None:
    """What was typed before the page is connected would be lost: the page is told then what stands in its fields."""
    for panel in panels:
        panel.props(INERT)

    def take() -> None:
        for panel in panels:
            panel.props(remove=INERT)

    context.client.on_connect(take)
