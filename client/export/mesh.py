"""A surface of equal density as a mesh of triangles: marching cubes by scikit-image, files by trimesh.

The surface is that of the densities that are drawn, 256 steps over the scene's window; where the bounds cut it, it is
closed. Normals point to what is less dense.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from volsplat.client.caller.interrupts import interrupts_held
from volsplat.client.export.local_origin import NOWHERE_ELSE, local_origin
from volsplat.client.files.whole_file import whole_file
from volsplat.client.session.single import SingleProcess
from volsplat.client.volume.clearest_entries import clearest_entries
from volsplat.client.volume.visible_blocks import opacities
from volsplat.program.extras import need
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES, Field
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.text.errors import BadInput

MOST_VOXELS = 400_000_000  # 4 bytes each while the surface is looked for, and as much again
BEYOND = -(2.0**20)  # a density outside the bounds: it puts the closing faces at the outermost voxels
OFF_STEPS = 1.0 / 64.0  # of a density step: a surface through voxels themselves has triangles without area
LEAST_DIGITS = 8  # of text files
GREY = (0.8, 0.8, 0.8)


class Written(NamedTuple):
    """What became of it."""

    triangles: int
    level: float  # in the volume's own units


def need_mesh() -> None:
    """Raises BadInput, with the cure, if meshes cannot be made here."""
    for library in ("skimage", "trimesh"):
        need(library, "a mesh", "export")


def write_mesh(
    single: SingleProcess,
    scene: Scene,
    path: Path,
    level: float | None,
    every: int,
    on_progress: Callable[[float], None],
) -> Written:
    """Write a .stl, .glb or .obj file. Raises BadInput if no surface has this level, in the volume's own units.

    Without one it is where the table of opacities rises through half of its greatest rise.
    """
    need_mesh()
    with interrupts_held():  # what these catch while they load can be a KeyboardInterrupt
        import skimage.measure  # noqa: F401
        import trimesh  # noqa: F401

    quantisation = single.volume.quantisation(scene.quantise)
    low, scale = quantisation.window[0], quantisation.density_scale
    density = edge_of_table(scene) if level is None else (level - low) * scale
    if not 0.0 < density < TABLE_ENTRIES - 1:
        raise BadInput(f"--level {level:g} is not within the window {_told(quantisation.window)}; widen --window")
    voxels = single.voxels(scene, every)
    values, there = _values(voxels, on_progress)
    corners, triangles = _surface(values, there, density)
    if not len(triangles):
        told = low + density / scale
        raise BadInput(f"no surface has the value {told:g}; the window is {_told(quantisation.window)}: give --level")
    to_physical = np.array(voxels.level.index_to_physical)
    index = np.array(voxels.first) + every * (corners - 1.0)  # one voxel is put around
    kind = path.suffix.lower()[1:]
    local = NOWHERE_ELSE if kind == "obj" else local_origin(single.volume.description.geometry)  # .obj is text
    points = index @ to_physical.T + (np.array(voxels.level.origin) - np.array(local))
    if np.linalg.det(to_physical) < 0.0:
        triangles = triangles[:, ::-1]
    voxel = np.linalg.norm(to_physical, axis=0).min()
    with whole_file(path) as file:
        file.write(_content(kind, points, triangles, _colour(scene, density), voxel, local))
    return Written(len(triangles), low + density / scale)


def _content(
    kind: str,
    points: NDArray[np.float64],
    triangles: NDArray[np.int64],
    colour: NDArray[np.uint8],
    voxel: float,
    local: Vector,
) -> bytes:
    """Of a file of this kind: points (n, 3) about the place `local`, in the volume's unit, as is a `voxel`'s size."""
    import trimesh

    mesh: Any = trimesh.Trimesh(points / voxel, triangles, process=False)
    mesh.visual.vertex_colors = np.tile(linear(colour) if kind == "glb" else colour, (len(points), 1))
    _ = mesh.face_normals  # which trimesh has of triangles of usual size alone, and keeps
    mesh.apply_scale(voxel)
    if kind == "glb" and local != NOWHERE_ELSE:
        placed, translation = trimesh.Scene(), np.eye(4)
        translation[:3, 3] = local
        placed.add_geometry(mesh, transform=translation)
        mesh = placed
    made = mesh.export(file_type=kind, **({"digits": _digits(voxel)} if kind == "obj" else {}))
    return made.encode() if isinstance(made, str) else bytes(made)


def linear(colour: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A colour as glTF has those of vertices: sRGB's curve is undone (glTF 2.0, 3.7.2.1)."""
    shown = colour[:3] / 255.0
    return _eight_bits(np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4))


def _digits(voxel: float) -> int:
    """After the point, so that places are told to a ten-thousandth of a voxel in whatever unit."""
    return max(LEAST_DIGITS, 4 - math.floor(math.log10(voxel)))


def edge_of_table(scene: Scene) -> float:
    """The density, in steps, at which the opacity is halfway up its greatest rise. Raises BadInput."""
    table = opacities(scene)
    if table is None:
        raise BadInput(f"opacity goes by {scene.cross_bar.opac} here, so that no density is an edge; give --level")
    tops = [n for n, (a, b) in enumerate(pairwise([*table, -1.0])) if b < a]  # the last entry of each rise
    bottoms = [0, *(top + 1 for top in tops[:-1])]
    rise, bottom = max((table[top] - table[bottom], -bottom) for bottom, top in zip(bottoms, tops, strict=True))
    bottom = -bottom
    if rise <= 0.0:
        raise BadInput("the opacity rises nowhere with density, so that it has no edge; give --level")
    half = table[bottom] + rise / 2
    above = next(n for n in range(bottom + 1, len(table)) if table[n] >= half)
    return above - (table[above] - half) / (table[above] - table[above - 1])


def _values(voxels: Any, on_progress: Callable[[float], None]) -> tuple[NDArray[np.float32], NDArray[np.bool_] | None]:
    """Densities (k, j, i) with one more on every side, and where there are data, if not everywhere."""
    ni, nj, nk = (size + 2 for size in voxels.dims)
    if ni * nj * nk > MOST_VOXELS:
        raise BadInput(
            f"a mesh of {ni * nj * nk} voxels would take too much memory, {MOST_VOXELS} are the most; give --every 2, "
            "which takes each second voxel on each axis, or --bounds"
        )
    values = np.full((nk, nj, ni), BEYOND, dtype=np.float32)
    there: NDArray[np.bool_] | None = None
    for done, ((i, j, k), sheet, known) in enumerate(voxels.densities(), 1):
        place = k + 1, slice(j + 1, j + 1 + sheet.shape[0]), slice(i + 1, i + 1 + sheet.shape[1])
        values[place] = sheet
        if not known.all():
            there = np.ones(values.shape, dtype=bool) if there is None else there
            there[place] = known
        on_progress(done / voxels.sheets)
    return values, there


def _surface(
    values: NDArray[np.float32], there: NDArray[np.bool_] | None, density: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Corners (n, 3) as i, j, k and triangles that turn counter-clockwise seen from outside; none if there are none."""
    from skimage.measure import marching_cubes

    off = density + OFF_STEPS if density == round(density) else density
    if not values.max() > off:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    try:
        corners, triangles, _, _ = marching_cubes(values, off, mask=there, gradient_direction="descent")
    except RuntimeError as error:
        if not str(error).startswith("No surface found"):
            raise  # else the mask leaves no cell that the surface passes
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    return corners[:, ::-1].astype(np.float64), triangles.astype(np.int64)


def _colour(scene: Scene, density: float) -> NDArray[np.uint8]:
    """What voxels of this density reflect and emit, if density decides it; else grey. 8 bits, with alpha."""
    if scene.plane.patches:
        entry = clearest_entries(scene.plane.patches)[round(density)]
        return _eight_bits(np.array(entry.refl) + np.array(entry.emit) * scene.shading.emitted)
    colour = np.zeros(3)
    for field, table, shown in (
        (scene.cross_bar.refl, scene.tables.refl, True),
        (scene.cross_bar.emit, scene.tables.emit, scene.shading.emitted),
    ):
        if shown and field != Field.DENSITY:
            colour = np.array(GREY)
            break
        colour = colour + np.array(table.entries()[round(density)]) * shown
    return _eight_bits(colour)


def _eight_bits(colour: NDArray[np.float64]) -> NDArray[np.uint8]:
    return np.round(255 * np.append(np.clip(colour, 0.0, 1.0), 1.0)).astype(np.uint8)


def _told(window: tuple[float, float]) -> str:
    return f"{window[0]:g} to {window[1]:g}"
