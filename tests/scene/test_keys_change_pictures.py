"""Every key of a scene changes a picture: none is declared and then forgotten on its way to the pixels."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import msgspec
import pytest

from volsplat.client.image.image_file import over_background
from volsplat.client.memory.array_volume import Volume
from volsplat.client.phantoms.make_phantom import make_phantom
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Image, Light, Scene, View
from volsplat.protocol.description.scene_keys import KEYS
from volsplat.protocol.description.shading_tables import ColourTable, ScalarTable, Tables
from volsplat.protocol.description.view_rotation import rotation_from_angles


class Other(NamedTuple):
    """Another value than that of the scene below, and the step that shows it."""

    value: Any
    step: Step = Step.F


# What says which pictures are drawn, and not what is in them.
NOT_IN_A_PICTURE = {
    "view.up": "the named views, and how the hand turns",
    "refine.finest": "which step the page ends with",
    "refine.bare_buffer": "what is shown until a step is finished",
    "refine.striding": "which steps the page draws",
}

OTHERS = {
    "order": Other("btf"),
    "tables.emit.points": Other(((0.0, (0.1, 0.1, 0.1)),)),
    "tables.refl.points": Other(((0.0, (0.1, 0.9, 0.1)),)),
    "tables.opac.points": Other(((0.1, 0.0), (0.9, 0.9))),
    "tables.modu.points": Other(((0.0, 0.2), (1.0, 1.0))),
    "cross_bar.emit": Other("strength"),
    "cross_bar.refl": Other("grid-i"),
    "cross_bar.opac": Other("screen-y"),
    "cross_bar.modu": Other("density"),
    "plane.patches": Other(({"density": (0.3, 1.0), "opacity": 0.4},)),
    "shading.emitted": Other(False),
    "shading.diffuse": Other(False),
    "shading.specular": Other(False),
    "shading.modulation": Other(False),
    "shading.specular_power": Other(3.0),
    "shading.two_sided": Other(True),
    "light.direction": Other((1.0, 0.0, 0.2)),
    "light.fixed_to": Other("grid"),
    "light.shadows": Other(1.0, Step.G),
    "light.occlusion": Other(1.0, Step.G),
    "light.depth_cue": Other(0.5, Step.G),
    "light.silhouettes": Other(0.5, Step.G),
    "view.rotation": Other((0.0, 0.0, 0.0, 1.0)),
    "view.zoom": Other(1.1),
    "view.center": Other((9.0, 12.0, 10.0)),
    "bounds.low": Other((6, 0, 0)),
    "bounds.high": Other((-1, 20, -1)),
    "reconstruction.kernel": Other("bspline"),
    "reconstruction.radius": Other(1.5),
    "reconstruction.precise": Other(True),
    "reconstruction.slab": Other(0.5, Step.G),
    "reconstruction.slab_kernel": Other("gaussian", Step.G),
    "refine.lit_from": Other("A", Step.D),
    "image.width": Other(50),
    "image.height": Other(38),
    "image.background": Other((0.0, 0.0, 1.0)),
    "image.edges": Other(True),
    "quantise.window": Other((100.0, 900.0)),
    "quantise.directions": Other("paper"),
}


@pytest.fixture(scope="module")
def single() -> Iterator[SingleProcess]:
    with SingleProcess(Volume(make_phantom("head", size=(24, 30, 26))[0], spacing=(1.0, 1.0, 1.0))) as opened:
        yield opened


@pytest.fixture(scope="module")
def scene(single: SingleProcess) -> Scene:
    """Translucent, lit from the side, seen from none of its sides, large enough for footprints of several pixels."""
    return Scene(
        tables=Tables(
            emit=ColourTable(points=((0.0, (0.0, 0.0, 0.3)), (1.0, (0.5, 0.2, 0.1)))),
            refl=ColourTable(points=((0.0, (0.9, 0.6, 0.3)), (1.0, (0.3, 0.6, 0.9)))),
            opac=ScalarTable(points=((0.1, 0.0), (0.9, 0.3))),
            modu=ScalarTable(points=((0.0, 0.5), (0.5, 1.0))),
        ),
        light=Light(direction=(-0.6, 0.6, 0.5)),
        view=View(rotation=rotation_from_angles(30.0, 20.0), zoom=4.3, center=(12.0, 15.0, 13.0)),
        image=Image(width=90, height=80),
    )


def picture(single: SingleProcess, scene: Scene, step: Step) -> bytes:
    pixels = over_background(single.finish(scene, step).published.pixels, scene.image.background)
    return pixels.tobytes()


@pytest.mark.parametrize("place", OTHERS)
def test_each_key_changes_the_picture(single: SingleProcess, scene: Scene, place: str) -> None:
    key, other = KEYS[place], OTHERS[place]
    changed = key.put(scene, msgspec.convert(other.value, key.declared.kind))
    assert changed != scene
    alike = picture(single, changed, other.step) == picture(single, scene, other.step)
    assert not alike, f"{place} = {other.value} changes nothing"


def test_the_keys_of_slabs_alone_change_no_other_picture(single: SingleProcess, scene: Scene) -> None:
    alone = [place for place, key in KEYS.items() if key.told.slabs_alone]
    assert alone == [place for place, other in OTHERS.items() if other.step is Step.G]
    changed = scene
    for place in alone:
        changed = KEYS[place].put(changed, msgspec.convert(OTHERS[place].value, KEYS[place].declared.kind))
    assert picture(single, changed, Step.F) == picture(single, scene, Step.F)


def test_no_key_is_forgotten_here() -> None:
    assert set(OTHERS) | set(NOT_IN_A_PICTURE) == set(KEYS)
