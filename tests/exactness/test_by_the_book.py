"""docs/how_it_works/image.md suffices to draw the image: what was written from it alone draws the programs'."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
import torch

from by_the_book.book import Book, Colours
from by_the_book.drawing import draw
from by_the_book.fit import fitted
from by_the_book.tables import Patch, table
from support.scenes.rendering import rendered
from tolerances import FIT, ONE_LEVEL
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.patches import Patch as ScenePatch
from volsplat.protocol.description.patches import Plane
from volsplat.protocol.description.scene import (
    Bounds,
    ColourTable,
    CrossBar,
    Field,
    Image,
    Kernel,
    Light,
    Order,
    Reconstruction,
    ScalarTable,
    Scene,
    Shading,
    Step,
    Tables,
    View,
)
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry.matrices import IDENTITY, Matrix
from volsplat.protocol.rules.footprint_shape import kernel_radius
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.refinement import active_shading
from volsplat.protocol.rules.resolved_view import resolved_bounds, resolved_center, screen_rotation
from volsplat.protocol.rules.shading_rule import BLACK

MATRICES: dict[str, Matrix] = {
    "cubic": IDENTITY,
    "unequal": ((0.7, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.9)),
    "mirrored": ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "skewed": ((1.0, 0.2, 0.1), (0.0, 0.9, -0.3), (0.0, 0.1, 1.2)),
}
ROTATIONS = {
    "from above": (0.0, 0.0, 0.0, 1.0),
    "oblique": (0.3, -0.5, 0.2, 0.8),
    "rolled": (0.1, 0.05, 0.65, 0.7),
    "from behind": (0.2, 0.95, 0.1, 0.1),
}
FIELDS = list(Field)
WINDOW, STRENGTH_SCALE = (-40.0, 215.0), 3.0


def volume(seed: int, dims: tuple[int, int, int]) -> torch.Tensor:
    """A blob in noise, with voxels that have no data: (k, j, i)."""
    generator = torch.Generator().manual_seed(seed)
    places = torch.meshgrid(*(torch.linspace(-1, 1, n, dtype=torch.float64) for n in reversed(dims)), indexing="ij")
    far = places[0] ** 2 + (places[1] - 0.1) ** 2 + (places[2] - 0.2) ** 2
    values = 200 * torch.exp(-2 * far) + 60 * torch.rand(far.shape, generator=generator, dtype=torch.float64) - 50
    return values.masked_fill(torch.rand(far.shape, generator=generator) < 0.03, torch.nan)


def scene(seed: int, view: View, order: Order, kernel: Kernel, edges: bool, bounds: Bounds) -> Scene:
    """One that has a bit of everything."""
    chosen = np.random.default_rng(seed)
    fields = [FIELDS[n] for n in chosen.integers(len(FIELDS), size=4)]
    ramp = ((0.0, 0.0), (0.15, 0.0), (0.15, 0.1), (0.8, float(chosen.uniform(0.2, 1.0))))
    modu = ((0.0, float(chosen.uniform(0.3, 1.0))), (0.5, 1.0), (1.0, 0.8))
    colours = tuple((p, (p, 0.5 * chosen.random(), 0.9 - 0.8 * p)) for p in (0.0, 0.4, 1.0))
    return Scene(
        tables=Tables(ColourTable(colours), ColourTable(colours[::2]), ScalarTable(ramp), ScalarTable(modu)),
        cross_bar=CrossBar(fields[0], fields[1], fields[2] if seed % 4 == 2 else Field.DENSITY, fields[3]),
        shading=Shading(
            modulation=seed % 3 > 0,
            two_sided=seed % 2 > 0,
            specular_power=float(chosen.uniform(1, 30)),
            emitted=seed % 5 > 0,
        ),
        light=Light(direction=(0.4, -0.3, 0.8), fixed_to="grid" if seed % 2 else "world"),
        view=view,
        bounds=bounds,
        reconstruction=Reconstruction(kernel, radius="default" if seed % 2 else 1.6, precise=seed % 3 == 0),
        order=order,
        image=Image(width=27, height=24, edges=edges),
    )


def colours(table: ColourTable) -> Colours:
    red, green, blue = ([(position, colour[n]) for position, colour in table.points] for n in range(3))
    return red, green, blue


def book(values: torch.Tensor, geometry: Geometry, scene: Scene, step: Step, octahedral: bool) -> Book:
    """The same in plain numbers."""
    active = active_shading(scene, step)
    bounds = resolved_bounds(scene, geometry)
    assert scene.view.zoom != "fit"
    return Book(
        values=values.numpy(),
        to_physical=np.array(geometry.index_to_physical),
        window=WINDOW,
        strength_scale=STRENGTH_SCALE,
        octahedral=octahedral,
        step=step.value,
        size=(scene.image.width, scene.image.height),
        rotation=scene.view.rotation,
        zoom=scene.view.zoom,
        center=resolved_center(scene, geometry),
        bounds=(bounds.low, bounds.high),
        front_to_back=scene.order == Order.FRONT_TO_BACK,
        kernel=scene.reconstruction.kernel.value,
        radius=kernel_radius(scene.reconstruction),
        precise=scene.reconstruction.precise,
        emit=colours(scene.tables.emit) if active.emitted else colours(BLACK),
        refl=colours(scene.tables.refl),
        opac=list(scene.tables.opac.points),
        modu=list(scene.tables.modu.points) if scene.shading.modulation else [(0.0, 1.0)],
        patches=[
            Patch(*patch.ends, patch.strength, patch.soft, patch.opacity, patch.emit, patch.refl)
            for patch in scene.plane.patches
        ],
        emits=active.emitted,
        cross_bar={name: getattr(scene.cross_bar, name).value for name in ("emit", "refl", "opac", "modu")},
        light=scene.light.direction,
        light_on_screen=scene.light.fixed_to == "world",
        lit=(active.diffuse, active.specular),
        two_sided=scene.shading.two_sided,
        power=scene.shading.specular_power,
        edges=scene.image.edges,
    )


# Each pair of a step and a matrix, of a matrix and a rotation, and of a rotation and a zoom.
CASES = [
    (step, matrix, list(ROTATIONS)[(number + n) % 4], (0.6, 1.0, 2.3, 4.1)[(number + n // 4) % 4])
    for n, step in enumerate("ABCDEF")
    for number, matrix in enumerate(MATRICES)
]


PATCHES = (
    ScenePatch(density=(0.1, 0.7), strength=(0.0, 0.8), top=(0.3, 0.6), soft=0.7, opacity=0.4, refl=(0.9, 0.5, 0.2)),
    ScenePatch(
        density=(0.5, 1.0), strength=(0.1, 1.0), soft=0.3, opacity=0.8, emit=(0.1, 0.2, 0.4), refl=(0.3, 0.9, 0.9)
    ),
    ScenePatch(density=(0.2, 0.2), strength=(0.05, 0.6), top=(0.0, 0.5), soft=0.0, opacity=0.2),
)


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
