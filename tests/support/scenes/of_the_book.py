"""Volumes and scenes that renderers written from the docs alone draw, and the same in plain numbers."""

import numpy as np
import torch

from by_the_book.book import Book, Colours
from by_the_book.tables import Patch
from volsplat.protocol.description.patches import Patch as ScenePatch
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import (
    Bounds,
    Image,
    Kernel,
    Light,
    Order,
    Reconstruction,
    Scene,
    Shading,
    View,
)
from volsplat.protocol.description.shading_tables import ColourTable, CrossBar, Field, ScalarTable, Tables
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry.matrices import IDENTITY, Matrix
from volsplat.protocol.rules.footprint_shape import kernel_radius
from volsplat.protocol.rules.refinement import active_shading
from volsplat.protocol.rules.resolved_view import resolved_bounds, resolved_center
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


PATCHES = (
    ScenePatch(density=(0.1, 0.7), strength=(0.0, 0.8), top=(0.3, 0.6), soft=0.7, opacity=0.4, refl=(0.9, 0.5, 0.2)),
    ScenePatch(
        density=(0.5, 1.0), strength=(0.1, 1.0), soft=0.3, opacity=0.8, emit=(0.1, 0.2, 0.4), refl=(0.3, 0.9, 0.9)
    ),
    ScenePatch(density=(0.2, 0.2), strength=(0.05, 0.6), top=(0.0, 0.5), soft=0.0, opacity=0.2),
)
