"""A dialog beside which the volume can still be turned."""

from __future__ import annotations

from nicegui import ui


class SideDialog(ui.dialog):
    """At the window's right. Escape within it closes it, which Quasar has only dialogs do that hold up the page.

    Where nothing has the focus then, `opener` has it again: the menu's item that opened it is gone.
    """

    def __init__(self, name: str, opener: ui.button) -> None:
        super().__init__()
        self.props("seamless position=right")
        with self:
            self.card = ui.card().classes("vs-dialog")
        self.card.on("keyup.esc", self.close)  # a menu that is open in it keeps that one to itself
        to_opener = f"getHtmlElement({opener.id}).focus()"
        self.on("hide", js_handler=f"() => document.activeElement === document.body && {to_opener}")
        with self.card:
            ui.label(name).classes("vs-name")
