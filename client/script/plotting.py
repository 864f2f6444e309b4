"""One line for one volume: its image, the picture or viewport that suits, the page, a file for other programs."""

from __future__ import annotations

import inspect
import os
import warnings
from contextlib import ExitStack
from pathlib import Path
from typing import Any, overload

from volsplat.client.caller.arguments import checked_number, checked_scene, checked_step
from volsplat.client.caller.own_frames import level_of_caller
from volsplat.client.export.export import check_export, write_export
from volsplat.client.export.view_light import LIGHTS, Light
from volsplat.client.figure.figure import Figure, check_figure
from volsplat.client.image.empty_image import why_empty
from volsplat.client.image.written_apart import check_written_apart
from volsplat.client.memory.array_source import UNPLACED
from volsplat.client.memory.array_volume import Volume
from volsplat.client.scene.lit_from import lit_from
from volsplat.client.scene.presets import PRESETS, Preset
from volsplat.client.scene.suited import why_unsuited
from volsplat.client.script.notebook_cells import close_when_cell_runs_again, in_notebook
from volsplat.client.script.picture_names import unused_picture
from volsplat.client.script.rendered_image import RenderedFigure, RenderedImage
from volsplat.client.session.session import Session
from volsplat.client.session.single import SingleProcess
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.program.extras import need
from volsplat.program.this_machine import usable_cores
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.text.errors import BadInput

GRACE_SECONDS = 600.0
DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")


class UnsuitedPreset(UserWarning):
    """The preset is made for another kind of data than the volume says that it is."""


class VolumeNote(UserWarning):
    """What had to be assumed of a volume, or is odd about it: what the command prints as notes."""


class EmptyImage(UserWarning):
    """Nothing is visible in an image: it may be meant, or a table, the window or the view may have gone wrong."""


class MissingLabel(UserWarning):
    """A figure lacks a label, since what it points at lies outside the picture."""


@overload
def render(
    volume: Any,
    scene: Scene | Preset | str | None = None,
    step: Step | str = Step.F,
    figure: None = None,
    **changes: Any,
) -> RenderedImage: ...


@overload
def render(
    volume: Any, scene: Scene | Preset | str | None = None, step: Step | str = Step.F, *, figure: Figure, **changes: Any
) -> RenderedFigure: ...


@overload
def render(
    volume: Any, scene: Scene | Preset | str | None, step: Step | str, figure: Figure, **changes: Any
) -> RenderedFigure: ...


def render(
    volume: Any,
    scene: Scene | Preset | str | None = None,
    step: Step | str = Step.F,
    figure: Figure | None = None,
    **changes: Any,
) -> RenderedImage | RenderedFigure:
    """The image of a volume: a path, an array or image in memory, a `Volume`, or a `Session` that has it open.

    `scene` is a Scene or a preset's name, else one chosen from the data; `changes` are those of `Scene.with_`, as
    size=300, rotation="front". With a Figure it is that, of its size in print. Draws in this process; a Session is
    quicker for many images. Warns by VolumeNote, UnsuitedPreset, EmptyImage and MissingLabel. Raises BadInput, and with
    a Session what its `render` raises.
    """
    step = checked_step(step)
    if figure is not None:
        check_figure(figure)
    if isinstance(volume, Session | SingleProcess):
        return _rendered(volume, scene, step, figure, changes)
    with SingleProcess(volume, threads=usable_cores()) as renderer:
        _tell_notes(renderer.volume)
        return _rendered(renderer, scene, step, figure, changes)


def plot(
    volume: Any, scene: Scene | Preset | str | None = None, *, save: str | Path | None = None, **changes: Any
) -> Any:
    """Show a volume, as `render` takes it: in a notebook, on the desktop, or as a file.

    In a notebook it is a viewport that turns (extra [notebook]), else a picture. In a script with a display it is the
    page in the browser (extra [ui]), until Ctrl-C; without one a PNG in the working folder, named after the volume.
    With `save` it is that file, wherever. Returns the widget or the image, of the page None. Raises as `render`.
    """
    if save is None and in_notebook():
        return _in_notebook(volume, scene, changes)
    if save is None and _has_display():
        return view(volume, scene, **changes)
    image = render(volume, scene, **changes)
    path = Path(save) if save is not None else unused_picture(image.volume_path, image.volume_name)
    image.save(path)
    print(path)
    return image


def view(
    volume: Any,
    scene: Scene | Preset | str | None = None,
    *,
    port: int = 0,
    browser: bool = True,
    grace: float = GRACE_SECONDS,
    **changes: Any,
) -> None:
    """Show a volume, as `render` takes it, in the browser with every control of the scene, until Ctrl-C.

    In a notebook that is the kernel's interrupt. Ends also when no page has been open for `grace` seconds. Its address
    is printed; it is for this machine alone. A `Session` goes on.
    Raises BadInput without the extra [ui].
    """
    for library in ("nicegui", "PIL"):
        need(library, "the page", "ui")
    from volsplat.client.script.page_window import show_page

    if isinstance(volume, Session):
        show_page(volume, _scene(volume.volume, scene, changes, watched=True), port, browser, grace, lent=True)
        return
    with _opened(volume) as session:
        show_page(session, _scene(session.volume, scene, changes, watched=True), port, browser, grace)


def export(
    volume: Any,
    path: str | Path,
    scene: Scene | Preset | str | None = None,
    *,
    level: float | None = None,
    every: int = 1,
    light: Light | None = None,
    **changes: Any,
) -> str:
    """Write what is visible of a volume for other programs; says what the file holds.

    A .ply file holds the visible voxels as 3-D Gaussians, with the light that each "viewer" sees (the default), that of
    the "scene"'s view, or "even" light. .stl, .glb and .obj files hold the surface of one value, `level`, in
    the volume's own units (extra [export]). `volume`, `scene` and `changes` are as in `render`, save for a `Session`,
    whose voxels its servers hold; `every` takes every so many voxels on each axis. Raises BadInput.
    """
    place = Path(path)
    if light is not None and light not in LIGHTS:
        raise BadInput(f"light must be {', '.join(LIGHTS[:-1])} or {LIGHTS[-1]}, not {light!r}")
    if isinstance(volume, Session):
        raise BadInput("an open session's voxels are with its servers; give export the volume itself")
    level = None if level is None else checked_number(level, "level")
    check_export(place, level, light)

    def written(single: SingleProcess) -> str:
        single.volume.check_has_values()
        if single.path is not None:
            check_written_apart(single.path, place)
        return write_export(single, _scene(single.volume, scene, changes), place, level, every, light)

    if isinstance(volume, SingleProcess):
        return written(volume)
    with SingleProcess(volume, threads=usable_cores()) as single:
        _tell_notes(single.volume)
        return written(single)


def _in_notebook(volume: Any, scene: Scene | Preset | str | None, changes: dict[str, Any]) -> Any:
    from importlib.util import find_spec

    if any(find_spec(library) is None for library in ("anywidget", "nicegui")):
        return render(volume, scene, **changes)
    with ExitStack() as opening:
        session = volume if isinstance(volume, Session) else opening.enter_context(_opened(volume))
        widget = session.widget(_scene(session.volume, scene, changes, watched=True))
        opening.callback(widget.close)
        close_when_cell_runs_again(opening.pop_all())
    return widget


def _opened(volume: Any) -> Session:
    session = Session(volume)
    _tell_notes(session.volume)
    return session


def _tell_notes(volume: SurveyedVolume) -> None:
    """Of a volume that was opened for this; that an array does not say how it lies was told with its own warning."""
    for note in volume.warnings():
        if not note.startswith(UNPLACED):
            warnings.warn(note, VolumeNote, stacklevel=level_of_caller())


def _rendered(
    renderer: Session | SingleProcess,
    scene: Scene | Preset | str | None,
    step: Step,
    figure: Figure | None,
    changes: dict[str, Any],
) -> RenderedImage | RenderedFigure:
    of = renderer.volume
    of.check_has_values()
    wanted = _scene(of, scene, changes)
    if figure is not None:
        from volsplat.client.figure.layout import sized
        from volsplat.client.figure.pointing_labels import why_unlabelled

        wanted = sized(figure, wanted, of)
        if why := why_unlabelled(figure.labels, wanted, of):
            warnings.warn(why, MissingLabel, stacklevel=level_of_caller())
    image = RenderedImage(renderer.finish(wanted, step).published, wanted, of, renderer.path)
    if why := why_empty(image.numpy(), wanted):
        warnings.warn(why, EmptyImage, stacklevel=level_of_caller())
    return image if figure is None else RenderedFigure(image, figure, of)


def _scene(
    volume: SurveyedVolume, scene: Scene | Preset | str | None, changes: dict[str, Any], watched: bool = False
) -> Scene:
    """What is drawn; what is `watched` and no scene of the caller's is lit from its first steps on."""
    for key in changes:
        if key == "preset":
            raise BadInput(
                f"a preset is given as the scene: scene={changes[key]!r} in place of preset={changes[key]!r}"
            )
        if key in inspect.signature(Volume).parameters:
            raise BadInput(f"{key}= is of the volume, not of its scene: vs.Volume(array, {key}={changes[key]!r})")
    wanted = PRESETS.name_of(scene) if isinstance(scene, Preset) else scene
    if wanted is not None and not isinstance(wanted, str):
        return checked_scene(wanted).with_(**changes)
    begun = _begun(volume, wanted, changes)
    return (lit_from(begun) if watched else begun).with_(**changes)


def _begun(volume: SurveyedVolume, preset: str | None, changes: dict[str, Any]) -> Scene:
    """The default or a preset's scene before its changes, under the window that these set."""
    windowed = {key: value for key, value in changes.items() if key in ("quantise", "window")}
    begun = volume.begun_scene(preset)
    if preset is not None and (why := why_unsuited(preset, volume.subject())):
        warnings.warn(why, UnsuitedPreset, stacklevel=level_of_caller())
    return volume.begun_scene(preset, begun.with_(**windowed).quantise) if windowed else begun


def _has_display() -> bool:
    from importlib.util import find_spec

    return any(map(os.environ.get, DISPLAYS)) and find_spec("nicegui") is not None
