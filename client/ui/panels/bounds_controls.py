"""The bounds on the page: on each axis a range, and a field for either end."""

from __future__ import annotations

import msgspec
from nicegui import ui

from volsplat.client.ui.controls.controls import SceneEditor, title
from volsplat.client.ui.controls.slider import Slider
from volsplat.client.ui.controls.text_field import whole_number_field
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.description.scene import Bounds, Scene
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.rules.resolved_view import resolved_bounds

AXES = "ijk"

replace = msgspec.structs.replace


def bounds_controls(editor: SceneEditor, viewing: Viewing) -> None:
    """The part of the grid that is drawn, axis by axis."""
    geometry = viewing.volume.description.geometry
    with ui.element("div").classes("vs-row"):
        title("Bounds")
        ui.element("div").classes("vs-spread")
        reset = ui.button("reset", on_click=lambda: editor.change(lambda scene: replace(scene, bounds=Bounds())))
        reset.props("dense flat no-caps").classes("vs-quiet-button")
    editor.follow(lambda scene: reset.set_enabled(scene.bounds != Bounds()))
    for axis, letter in enumerate(AXES):
        _axis_bounds(editor, geometry, axis, letter)


def _axis_bounds(editor: SceneEditor, geometry: Geometry, axis: int, letter: str) -> None:
    end = geometry.dims[axis]

    def get(scene: Scene, side: int) -> int:
        return resolved_bounds(scene, geometry)[side][axis]

    def slid(scene: Scene, position: dict[str, int]) -> Scene:
        low, high = int(position["min"]), int(position["max"])
        if low == high:  # one voxel at least
            low, high = (low, high + 1) if low < end else (low - 1, high)
        return bounded(bounded(scene, geometry, axis, low=0, high=end), geometry, axis, low=low, high=high)

    with ui.element("div").classes("vs-row vs-bound"):
        whole_number_field(
            editor,
            f"lowest {letter}",
            lambda scene: get(scene, 0),
            lambda scene, value: bounded(scene, geometry, axis, low=value),
        ).props(f'prefix="{letter}"')
        Slider(
            editor,
            [f"bounds on {letter}, lowest", f"bounds on {letter}, end"],
            (0, end),
            1,
            lambda scene: {"min": get(scene, 0), "max": get(scene, 1)},
            slid,
            lambda scene: [str(get(scene, side)) for side in (0, 1)],
        )
        whole_number_field(
            editor,
            f"end of {letter}",
            lambda scene: get(scene, 1),
            lambda scene, value: bounded(scene, geometry, axis, high=value),
        )


def bounded(scene: Scene, geometry: Geometry, axis: int, *, low: int | None = None, high: int | None = None) -> Scene:
    """The scene with other bounds on one axis. Raises ValueError if the volume has no such bounds."""
    lows, highs = list(scene.bounds.low), list(scene.bounds.high)
    if low is not None:
        lows[axis] = low
    if high is not None:
        highs[axis] = -1 if high == geometry.dims[axis] else high
        if high < 0:  # would mean the end
            raise ValueError(f"bounds on {AXES[axis]} must end above 0, not at {high}")
    cut = replace(scene, bounds=Bounds(low=_index(lows), high=_index(highs)))
    resolved_bounds(cut, geometry)
    return cut


def _index(values: list[int]) -> Index:
    i, j, k = values
    return (i, j, k)
