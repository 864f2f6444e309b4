"""Several volumes in one movie, as the steps of a series in time: opened one after another."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager

from volsplat.client.session.renderer import Renderer
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.text.errors import BadInput

ONE_GRID = "the volumes of a movie need grids of the same size and spacing"


def renderers_in_turn(
    volumes: Sequence[str], frames: int, opened: Callable[[str], AbstractContextManager[Renderer]]
) -> Generator[Renderer, None, None]:
    """What draws each of so many frames, which the volumes share evenly; one volume is open at a time.

    Close it to close the volume whose turn it is. Raises BadInput for a volume on another grid than the first.
    """
    grid: Geometry | None = None
    for number, name in enumerate(volumes):
        with opened(name) as renderer:
            geometry = renderer.volume.description.geometry
            grid = grid or geometry
            if not geometry.is_like(grid):
                raise BadInput(f"{name}: {_grid_words(geometry)}, but {volumes[0]} has {_grid_words(grid)}; {ONE_GRID}")
            for _ in range(first_frame(number + 1, volumes, frames) - first_frame(number, volumes, frames)):
                yield renderer


def first_frame(number: int, volumes: Sequence[str], frames: int) -> int:
    """The frame, from 0, in which the volume of this number is first seen."""
    return -(-number * frames // len(volumes))


def _grid_words(geometry: Geometry) -> str:
    size = " x ".join(map(str, geometry.dims))
    spacing = " x ".join(f"{length:.6g}" for length in geometry.spacing)
    return f"{size} voxels {spacing} apart"
