"""docs/how_it_works/image.md suffices to draw the image: what was written from it alone draws the programs'."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
import torch

from by_the_book.drawing import draw
from by_the_book.fit import fitted
from by_the_book.tables import table
from support.scenes.of_the_book import (
    MATRICES,
    PATCHES,
    ROTATIONS,
    STRENGTH_SCALE,
    WINDOW,
    book,
    scene,
    volume,
)
from support.scenes.rendering import rendered
from tolerances import FIT, ONE_LEVEL
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.patches import Plane
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Bounds, Image, Kernel, Order, Shading, View
from volsplat.protocol.description.shading_tables import ScalarTable
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.rules.footprint_shape import kernel_radius
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.resolved_view import resolved_bounds, screen_rotation

# Each pair of a step and a matrix, of a matrix and a rotation, and of a rotation and a zoom.
CASES = [
    (step, matrix, list(ROTATIONS)[(number + n) % 4], (0.6, 1.0, 2.3, 4.1)[(number + n // 4) % 4])
    for n, step in enumerate("ABCDEF")
    for number, matrix in enumerate(MATRICES)
]


@pytest.mark.parametrize(("step", "matrix", "rotation", "zoom"), CASES)
def test_the_page_suffices(step: str, matrix: str, rotation: str, zoom: float) -> None:
    seed = CASES.index((step, matrix, rotation, zoom))
    dims = (6, 9, 7) if zoom > 1 else (11, 9, 10)
    geometry = Geometry(dims, MATRICES[matrix])
    order = (Order.FRONT_TO_BACK, Order.BACK_TO_FRONT)[seed % 2]
    bounds = Bounds(low=(1, 0, 1), high=(-1, 8, 5)) if seed % 4 == 1 else Bounds()
    view = View(rotation=ROTATIONS[rotation], zoom=zoom, center=(2.3, 4.0, 3.1) if seed % 3 else "middle", up="+z")
    one = scene(seed, view, order, list(Kernel)[seed // 4 % 4], seed % 2 == 0, bounds)
    values, octahedral = volume(seed, dims), seed % 3 != 1
    quantisation = Quantisation(WINDOW, STRENGTH_SCALE, "octahedral" if octahedral else "paper")
    programs = rendered(values, geometry, one, Step(step), quantisation)
    by_the_book = torch.from_numpy(draw(book(values, geometry, one, Step(step), octahedral)))
    assert programs.shape == by_the_book.shape and (step in "AB" or float(programs[..., 3].max()) > 0)
    assert float((programs - by_the_book).abs().max()) <= ONE_LEVEL


@pytest.mark.parametrize(("step", "seed"), [("A", 1), ("C", 2), ("D", 3), ("E", 5), ("F", 8)])
def test_it_suffices_for_patches_over_density_and_strength(step: str, seed: int) -> None:
    dims = (9, 8, 10)
    geometry = Geometry(dims, MATRICES["skewed"])
    view = View(rotation=ROTATIONS["oblique"], zoom=1.7, up="+z")
    one = scene(seed, view, Order.FRONT_TO_BACK, Kernel.GAUSSIAN, False, Bounds())
    one = msgspec.structs.replace(one, plane=Plane(patches=PATCHES))
    values = volume(seed, dims)
    quantisation = Quantisation(WINDOW, STRENGTH_SCALE, "octahedral")
    programs = rendered(values, geometry, one, Step(step), quantisation)
    by_the_book = torch.from_numpy(draw(book(values, geometry, one, Step(step), octahedral=True)))
    assert float(programs[..., 3].max()) > 0
    assert float((programs - by_the_book).abs().max()) <= ONE_LEVEL


def test_it_suffices_for_a_fit(tmp_path: Path) -> None:
    values = make_phantom("head", size=(34, 14, 12))[0].float()
    values[1, 1, 1] = values.max()  # a stray
    values[6, 3, 28:] = 0.45 * values.max()  # a thread
    geometry = Geometry((34, 14, 12), MATRICES["skewed"], (5.0, -3.0, 1.0))
    write_volume(tmp_path / "head.nrrd", values, geometry)
    cut = Bounds(low=(9, 2, 3), high=(21, 11, 10))
    with SingleProcess(tmp_path / "head.nrrd") as single:
        default = single.volume.default_scene()
        window = single.volume.quantisation(default.quantise).window
        cases = ((True, 300, Bounds(), 0.8), (False, 12, Bounds(), 0.8), (False, 300, cut, 0.008))
        for edges, side, bounds, greatest in cases:
            opac = [(0.0, 0.0), (0.3, 0.0), (0.9, greatest)]
            one = msgspec.structs.replace(
                default,
                tables=msgspec.structs.replace(default.tables, opac=ScalarTable(tuple(opac))),
                shading=Shading(modulation=False),
                bounds=bounds,
                image=Image(width=side, height=side + 30, edges=edges),
            )
            for still in (True, False):
                view = (single.volume.settled if still else single.volume.fitted_to_turn)(one).view
                zoom, center = fitted(
                    values.numpy(),
                    np.array(geometry.index_to_physical),
                    window,
                    table(opac),
                    resolved_bounds(one, geometry),
                    kernel_radius(one.reconstruction),
                    (side, side + 30),
                    edges,
                    np.array(screen_rotation(view)) if still else None,
                )
                assert (view.zoom, *view.center) == pytest.approx((zoom, *center), rel=FIT)
