"""Several volumes in one movie, as the steps of a series in time: opened one after another."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

from volsplat.client.session.renderer import Renderer
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.shading_tables import Field
from volsplat.protocol.description.volume import Geometry, VolumeDescription
from volsplat.protocol.description.volume_name import volume_name
from volsplat.protocol.text.errors import BadInput

ONE_GRID = "the volumes of a movie need grids of the same size and spacing"
ONE_KIND = "the volumes of a movie need values of one kind, in one unit"
OWN_STRENGTHS = (
    "gradient strengths are scaled for each volume by itself: what the scene shows by them cannot be compared between "
    "the volumes"
)


def check_at_hand(name: str) -> None:
    """Raises BadInput for a file on this machine that is empty or that nobody may read, before others are drawn."""
    place, _ = volume_name(name)
    path = Path(place)
    if not path.is_file():
        return
    if not os.access(path, os.R_OK):
        raise BadInput(f"{path}: cannot be read; check its permissions")
    if path.stat().st_size == 0:
        raise BadInput(f"{path}: the file is empty; fetch or export the volume again")


def renderers_in_turn(
    volumes: Sequence[str],
    frames: int,
    opened: Callable[[str], AbstractContextManager[Renderer]],
    tell: Callable[[str], None],
) -> Generator[Renderer, None, None]:
    """What draws each of so many frames, which the volumes share evenly; one volume is open at a time.

    `tell` gets what is unusual about each, unless it was told of one before. Close it to close the volume whose turn it
    is. Raises BadInput for a first volume without values, and for one that is not like the first.
    """
    first: SurveyedVolume | None = None
    told: set[str] = set()
    for number, name in enumerate(volumes):
        with opened(name) as renderer:
            volume = renderer.volume
            if first is None:
                first = volume
                first.check_has_values()
            _check_like(volume.description, name, first.description, volumes[0])
            for note in _notes(volume):
                if note not in told:
                    tell(f"{name}: {note}" if len(volumes) > 1 else note)
                told.add(note)
            for _ in range(first_frame(number + 1, volumes, frames) - first_frame(number, volumes, frames)):
                yield renderer


def first_frame(number: int, volumes: Sequence[str], frames: int) -> int:
    """The frame, from 0, in which the volume of this number is first seen."""
    return -(-number * frames // len(volumes))


def shows_strengths(scene: Scene) -> bool:
    """Whether gradient strengths decide any of the picture."""
    bus, modulated = scene.cross_bar, scene.shading.modulation
    indices = {bus.emit, bus.refl, bus.opac, *([bus.modu] if modulated else [])}
    return bool(scene.plane.patches) or Field.STRENGTH in indices


def _check_like(told: VolumeDescription, name: str, first: VolumeDescription, first_name: str) -> None:
    """Raises BadInput."""
    if not told.geometry.is_like(first.geometry):
        grids = f"{_grid_words(told.geometry)}, but {first_name} has {_grid_words(first.geometry)}"
        raise BadInput(f"{name}: {grids}; {ONE_GRID}")
    if _value_words(told) != _value_words(first):
        raise BadInput(f"{name}: {_value_words(told)}, but {first_name} has {_value_words(first)}; {ONE_KIND}")


def _notes(volume: SurveyedVolume) -> list[str]:
    if not volume.has_values:
        return [*volume.description.warnings, "no voxel has a value, all are NaN or infinite: nothing of it is seen"]
    return volume.warnings()


def _grid_words(geometry: Geometry) -> str:
    size = " x ".join(map(str, geometry.dims))
    spacing = " x ".join(f"{length:.6g}" for length in geometry.spacing)
    return f"{size} voxels {spacing} apart"


def _value_words(told: VolumeDescription) -> str:
    """What decides how a scene's tables show them."""
    kind = told.kind if told.kind is not Kind.UNKNOWN else "values of no told kind"
    second = f" with {told.strength_name}" if told.second_scalar is not None else ""
    return f"{kind}{second}, {f'in {told.value_unit}' if told.value_unit else 'without a unit'}"
