"""The 2-D table's editor as an element of a page: patches over how often density and strength occur together."""

from __future__ import annotations

import base64
from collections.abc import Callable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import msgspec

from volsplat.client.ui.controls.controls import show_prop
from volsplat.client.ui.controls.hand_led import HandLed
from volsplat.client.ui.doors.static_files import MODULES
from volsplat.client.volume.field_axis import FieldAxis
from volsplat.protocol.description.patches import Patch, Patches

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class PatchEditor(HandLed, component="patch_editor_component.js", esm=MODULES):
    """Shows patches; `on_change(patches, settled)` tells what a person makes of them, `on_seen` that it is in sight."""

    def __init__(self, on_change: Callable[[Patches, bool], None], on_seen: Callable[[], object]) -> None:
        def changed(told: Any, settled: bool) -> None:
            on_change(tuple(map(patch_of, told)), settled)

        super().__init__([], changed)
        self.on("seen", on_seen)

    def show(self, patches: Patches) -> None:
        self.tell([_told(patch) for patch in patches])

    def show_axes(self, across: FieldAxis, up: FieldAxis) -> None:
        show_prop(self, "axes", {"across": asdict(across), "up": asdict(up)})

    def show_counts(self, levels: NDArray[np.uint8]) -> None:
        """How full each place is, (strengths, densities), as many as these."""
        self.run_method("showCounts", base64.b64encode(levels.tobytes()).decode(), len(levels))


def patch_of(told: Any) -> Patch:
    """The patch that a page tells of. Raises ValueError for what is none."""
    try:
        patch = msgspec.convert(told, Patch)
    except msgspec.ValidationError as error:
        raise ValueError(str(error)) from error
    return msgspec.structs.replace(patch, top="same") if patch.top == patch.density else patch


def _told(patch: Patch) -> dict[str, object]:
    lower, upper = patch.ends
    return {**msgspec.structs.asdict(patch), "density": lower, "top": upper}
