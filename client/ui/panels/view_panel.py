"""The view on the page: from where, how much of the volume, in which order and by which kernel, and how large."""

from __future__ import annotations

import msgspec
from nicegui import ui

from volsplat.client.scene.colours import colour_from_hex, nearest_hex
from volsplat.client.scene.view_rotation import Quaternion, about, named_view, product
from volsplat.client.scene.view_sides import STANDPOINTS, sides
from volsplat.client.ui.controls.colour_swatch import ColourSwatch
from volsplat.client.ui.controls.controls import (
    TOGGLE_PROPS,
    SceneEditor,
    choose,
    pressable,
    show_pressed,
)
from volsplat.client.ui.controls.density_window_fields import density_window_fields
from volsplat.client.ui.controls.image_size_fields import image_size_fields
from volsplat.client.ui.controls.slider import Slider
from volsplat.client.ui.controls.text_field import TextField, number_field, whole_number_field
from volsplat.client.ui.panels.steps_bar import ORDER_WORDS
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.client.volume.surveyed_volume import SurveyedVolume, asking_for_fit
from volsplat.protocol.description.scene import Bounds, Colour, Kernel, Order, Scene, Step
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.geometry.upright import UPS
from volsplat.protocol.rules.footprint_shape import DEFAULT_RADIUS
from volsplat.protocol.rules.frame_plan import resolved_bounds, resolved_center

ROLL_DEGREES = 15.0
ORDERS = {Order.FASTEST: "fastest", **ORDER_WORDS}
AXES = "ijk"

replace = msgspec.structs.replace


def view_panel(viewing: Viewing) -> None:
    """View, bounds, how the image forms, and what it is."""
    description = viewing.volume.description
    editor = SceneEditor(viewing.model, description.geometry, "view")
    with ui.element("section").classes("vs-panel").props('aria-label="view"'):
        ui.label("View").classes("vs-title")
        _sides(editor, viewing.volume)
        _up(editor, viewing.volume)
        _moves(editor, viewing.default_scene)
        _center(editor, description.geometry)
    with ui.element("section").classes("vs-panel").props('aria-label="bounds"'):
        _bounds(editor, description.geometry)
    with ui.element("section").classes("vs-panel").props('aria-label="refinement"'):
        ui.label("How the image forms").classes("vs-title")
        _order(editor)
        _lit_from(editor)
        _refine_switches(editor, viewing.volume)
        _kernel(editor)
    with ui.element("section").classes("vs-panel").props('aria-label="image"'):
        ui.label("Image").classes("vs-title")
        density_window_fields(editor, viewing.volume)
        _directions(editor)
        image_size_fields(editor, viewing.image_size)
        _background(editor)
        edges = ui.switch("white edges of the volume").props("dense").classes("vs-switch")
        choose(editor, edges, lambda scene: scene.image.edges, lambda scene, on: _image(scene, edges=on))


# -- view


def _sides(editor: SceneEditor, volume: SurveyedVolume) -> None:
    tooltips = {}
    with ui.element("div").classes("vs-buttons"):
        for side in STANDPOINTS:
            button = ui.button(side, color=None, on_click=lambda side=side: _turn(editor, named_view(side)))
            with button.props("dense flat no-caps"):
                tooltips[side] = ui.tooltip()

    def show(scene: Scene) -> None:
        for side, seen in sides(volume.description, volume.up_in(scene)).items():
            tooltips[side].set_text(f"seen from {seen.words}")

    editor.follow(show)


def _up(editor: SceneEditor, volume: SurveyedVolume) -> None:
    told = volume.stands_up
    with ui.element("div").classes("vs-row"):
        ui.label("up").classes("vs-label vs-narrow").tooltip(f"by itself {told.up}, {told.why}")
        select = ui.select({"auto": f"by itself ({told.up})", **{up: up for up in UPS}}).classes("vs-field")
        select.props('dense outlined options-dense aria-label="up"')
    choose(editor, select, lambda scene: scene.view.up, lambda scene, up: _viewed(scene, up=up), undoable=False)


def _moves(editor: SceneEditor, default_scene: Scene) -> None:
    def reset(scene: Scene) -> Scene:
        return replace(scene, view=replace(default_scene.view, up=scene.view.up))

    moves = {
        "reset": ("the view at the beginning", lambda: editor.change(reset, undoable=False)),
        "fit": ("all that is visible, from this side", lambda: editor.change(asking_for_fit, undoable=False)),
        "roll left": ("counter-clockwise", lambda: _turn(editor, rolled(editor.scene.view.rotation, ROLL_DEGREES))),
        "roll right": ("clockwise", lambda: _turn(editor, rolled(editor.scene.view.rotation, -ROLL_DEGREES))),
    }
    with ui.element("div").classes("vs-buttons"):
        for name, (meaning, move) in moves.items():
            ui.button(name, color=None, on_click=move).props("dense flat no-caps").tooltip(meaning)


def _turn(editor: SceneEditor, rotation: Quaternion) -> None:
    editor.change(lambda scene: _viewed(scene, rotation=rotation), undoable=False)


def rolled(rotation: Quaternion, degrees: float) -> Quaternion:
    """The rotation with the picture turned counter-clockwise."""
    return product(about(2, degrees), rotation)


def _viewed(scene: Scene, **parts: object) -> Scene:
    return replace(scene, view=replace(scene.view, **parts))


def _center(editor: SceneEditor, geometry: Geometry) -> None:
    def to_middle() -> None:
        editor.change(lambda scene: _viewed(scene, center="middle"), undoable=False)

    with ui.element("div").classes("vs-row"):
        ui.label("centre of the image, grid").classes("vs-label")
        ui.element("div").classes("vs-spread")
        middle = pressable("middle", to_middle)
    with ui.element("div").classes("vs-row vs-fields"):
        for axis, letter in enumerate(AXES):
            _center_field(editor, geometry, axis, letter)
    editor.follow(lambda scene: show_pressed(middle, scene.view.center == "middle"))


def _center_field(editor: SceneEditor, geometry: Geometry, axis: int, letter: str) -> None:
    def put(scene: Scene, value: float) -> Scene:
        center = list(resolved_center(scene, geometry))
        center[axis] = value
        return _viewed(scene, center=tuple(center))

    field = number_field(
        editor, f"centre {letter}", lambda scene: resolved_center(scene, geometry)[axis], put, undoable=False
    )
    field.props(f'prefix="{letter}"')


# -- bounds


def _bounds(editor: SceneEditor, geometry: Geometry) -> None:
    with ui.element("div").classes("vs-row"):
        ui.label("Bounds").classes("vs-title")
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
        if low == high:  # a slab of one voxel at least
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
            f"bounds on {letter}",
            (0, end),
            1,
            lambda scene: {"min": get(scene, 0), "max": get(scene, 1)},
            slid,
            "q-range",
        )
        whole_number_field(
            editor,
            f"end of {letter}",
            lambda scene: get(scene, 1),
            lambda scene, value: bounded(scene, geometry, axis, high=value),
        )


def bounded(scene: Scene, geometry: Geometry, axis: int, *, low: int | None = None, high: int | None = None) -> Scene:
    """The scene with other bounds on one axis. Raises ValueError where the volume has no such bounds."""
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


# -- how the image forms


def _order(editor: SceneEditor) -> None:
    with ui.element("div").classes("vs-row"):
        toggle = ui.toggle(ORDERS).props(f'{TOGGLE_PROPS} aria-label="order"').classes("vs-toggle")
    choose(editor, toggle, lambda scene: scene.order, lambda scene, order: replace(scene, order=order))


def _lit_from(editor: SceneEditor) -> None:
    with ui.element("div").classes("vs-row"):
        ui.label("lit from step").classes("vs-label")
        toggle = ui.toggle({step: step.value for step in Step}).props(TOGGLE_PROPS).classes("vs-toggle")
    choose(
        editor,
        toggle,
        lambda scene: scene.refine.lit_from,
        lambda scene, step: replace(scene, refine=replace(scene.refine, lit_from=step)),
    )


def _refine_switches(editor: SceneEditor, volume: SurveyedVolume) -> None:
    with ui.element("div").classes("vs-switches"):
        _refine_switch(
            editor, "bare_buffer", "bare buffer", "show what is being drawn without the finished step under it"
        )
        if volume.prepared is not None and len(volume.prepared.levels) > 1:
            _refine_switch(
                editor,
                "striding",
                "striding",
                "steps A and B leave out voxels, as in the paper, instead of drawing the means of a coarser level",
            )


def _refine_switch(editor: SceneEditor, name: str, label: str, meaning: str) -> None:
    switch = ui.switch(label).props("dense").classes("vs-switch")
    switch.tooltip(meaning)
    choose(
        editor,
        switch,
        lambda scene: getattr(scene.refine, name),
        lambda scene, on: replace(scene, refine=replace(scene.refine, **{name: on})),
    )


def _kernel(editor: SceneEditor) -> None:
    def rebuilt(scene: Scene, **parts: object) -> Scene:
        return replace(scene, reconstruction=replace(scene.reconstruction, **parts))

    def radius(scene: Scene) -> float:
        reconstruction = scene.reconstruction
        return DEFAULT_RADIUS[reconstruction.kernel] if reconstruction.radius == "default" else reconstruction.radius

    with ui.element("div").classes("vs-row"):
        ui.label("kernel").classes("vs-label vs-narrow")
        select = ui.select({kernel: kernel.value for kernel in Kernel}).classes("vs-field")
        select.props('dense outlined options-dense aria-label="kernel"')
    choose(
        editor, select, lambda scene: scene.reconstruction.kernel, lambda scene, kernel: rebuilt(scene, kernel=kernel)
    )
    with ui.element("div").classes("vs-row"):
        ui.label("radius").classes("vs-label vs-narrow").tooltip("in voxels, where the kernel is cut")
        Slider(
            editor,
            "radius",
            (1.0, 4.0),
            0.1,
            lambda scene: round(radius(scene), 1),
            lambda scene, value: rebuilt(scene, radius=round(value, 1)),
        )
        field = number_field(editor, "radius, a number", radius, lambda scene, value: rebuilt(scene, radius=value))
        field.classes("vs-short")
        default = pressable("default", lambda: editor.change(lambda scene: rebuilt(scene, radius="default")))
    editor.follow(lambda scene: show_pressed(default, scene.reconstruction.radius == "default"))


# -- the image


def _image(scene: Scene, **parts: object) -> Scene:
    return replace(scene, image=replace(scene.image, **parts))


def _directions(editor: SceneEditor) -> None:
    with ui.element("div").classes("vs-row"):
        label = ui.label("directions").classes("vs-label")
        label.tooltip("the code of gradient directions: octahedral is finer, the paper’s bands under sharp highlights")
        toggle = ui.toggle(["octahedral", "paper"]).props(f'{TOGGLE_PROPS} aria-label="directions"')
        toggle.classes("vs-toggle")
    choose(
        editor,
        toggle,
        lambda scene: scene.quantise.directions,
        lambda scene, directions: replace(scene, quantise=replace(scene.quantise, directions=directions)),
    )


def _background(editor: SceneEditor) -> None:
    """A swatch, and the colour as text."""

    def coloured(scene: Scene, colour: Colour) -> Scene:
        return _image(scene, background=colour)

    with ui.element("div").classes("vs-row"):
        ui.label("background").classes("vs-label")
        ColourSwatch(editor, "background", lambda scene: scene.image.background, coloured)
        TextField(
            editor,
            "background, #rrggbb",
            lambda scene: nearest_hex(scene.image.background),
            lambda scene, text: coloured(scene, colour_from_hex(text)),
        )
