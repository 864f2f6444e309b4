"""A scene's 2-D table: its checks, its TOML, its changes in Python, and what follows from it."""

import math

import msgspec
import pytest
from hypothesis import given

from support.scenes.arbitrary import plain_scene
from support.scenes.shadings import patches
from volsplat.client.export.mesh import edge_of_table
from volsplat.client.image.empty_image import why_empty
from volsplat.client.movie.key_frames import key_framed
from volsplat.client.scene.scene_file import scene_from_toml, scene_toml
from volsplat.client.volume.clearest_entries import clearest_entries
from volsplat.client.volume.visible_blocks import opacities
from volsplat.protocol.description.patches import MOST_PATCHES, Patch, Patches, Plane
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Order
from volsplat.protocol.description.scene_keys import TABLES, why_unused
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.rules.refinement import active_shading
from volsplat.protocol.rules.resolved_view import resolved_order
from volsplat.protocol.rules.shading_rule import shading_rule
from volsplat.protocol.text.errors import BadInput

PLAIN = plain_scene()
BONE = Patch(density=(0.6, 1.0), strength=(0.3, 1.0), top=(0.7, 1.0), opacity=0.8, refl=(0.9, 0.8, 0.7))
GEOMETRY = Geometry((9, 9, 9))


@given(drawn=patches())
def test_they_survive_their_file(drawn: Patches) -> None:
    scene = PLAIN.with_(plane=Plane(patches=drawn))
    assert scene_from_toml(scene_toml(scene), plain_scene(), "scene.toml") == scene


def test_a_scene_without_any_says_so_in_its_file() -> None:
    assert "\n[plane]\n" in scene_toml(PLAIN) and "\npatches = []\n" in scene_toml(PLAIN)


def test_a_patch_is_short_in_a_file_and_in_python() -> None:
    text = '[plane]\npatches = [{ density = [0.6, 1], strength = [0.3, 1], refl = "#ff8000" }]'
    read = scene_from_toml(text, PLAIN, "scene.toml")
    assert read == PLAIN.with_(patches=[{"density": (0.6, 1), "strength": (0.3, 1), "refl": "#ff8000"}])
    assert read.plane.patches[0].refl == pytest.approx((1.0, 128 / 255, 0.0))
    assert read.with_(patches=[]) == PLAIN
    assert PLAIN.with_(patches=[BONE]).plane.patches == (BONE,)


@pytest.mark.parametrize(
    ("patch", "complaint"),
    [
        ("density = [0.7, 0.6]", "plane.patches[0]: density of a patch must rise, not [0.7, 0.6]"),
        ("density = [0.5, 1.6]", "plane.patches[0]: density of a patch must be 0 to 1, not 1.6"),
        ("density = [0, 1], strength = [0.2, 0.2]", "strength of a patch must rise, not [0.2, 0.2]"),
        ("density = [0, 1], soft = 2", "soft of a patch must be 0 to 1, not 2.0"),
        ("density = [0, 1], refl = 'redd'", "plane.patches[0].refl"),
        ("density = [0, 1], opac = 1", "plane.patches[0]"),
        ("strength = [0, 1]", "plane.patches[0]"),
        ("density = 3", "plane.patches[0].density: 3 cannot be used; allowed: [{ density = [left, right]"),
    ],
)
def test_what_is_wrong_with_one_is_told_by_its_place(patch: str, complaint: str) -> None:
    with pytest.raises(BadInput) as told:
        scene_from_toml(f"[plane]\npatches = [{{ {patch} }}]", PLAIN, "scene.toml")
    assert complaint in str(told.value) and "\n" not in str(told.value)
    with pytest.raises(BadInput, match="^patches="):
        PLAIN.with_(patches=[{"density": (0.4, 0.2)}])


def test_there_is_an_end_to_how_many() -> None:
    with pytest.raises(ValueError, match=f"more than {MOST_PATCHES}"):
        Plane(patches=(BONE,) * (MOST_PATCHES + 1))


def test_they_take_the_place_of_the_four_tables() -> None:
    scene = PLAIN.with_(patches=[BONE])
    other = scene.with_(opac=[(0, 0.1), (1, 0.7)], refl=[(0, "red")], modulation=False)
    assert shading_rule(scene, Step.F) == shading_rule(other, Step.F)
    for table in TABLES:
        assert "2-D table" in why_unused(table, scene)


def test_a_plane_that_emits_nothing_is_lit_from_the_first_step() -> None:
    dark = PLAIN.with_(patches=[BONE])
    assert active_shading(dark, Step.A).diffuse
    bright = PLAIN.with_(patches=[BONE, msgspec.structs.replace(BONE, emit=(0.1, 0.0, 0.0))])
    assert not active_shading(bright, Step.A).diffuse


def test_the_fastest_order_follows_the_greatest_opacity() -> None:
    for opacity, order in ((1.0, Order.FRONT_TO_BACK), (1e-4, Order.BACK_TO_FRONT)):
        scene = PLAIN.with_(order=Order.FASTEST, patches=[msgspec.structs.replace(BONE, opacity=opacity)])
        assert resolved_order(scene, GEOMETRY) == order


def test_by_density_alone_it_is_what_is_most_opaque() -> None:
    faint = Patch(density=(0.2, 0.4), soft=0.0, opacity=0.1, refl=(0.0, 0.0, 1.0))
    scene = PLAIN.with_(patches=[msgspec.structs.replace(BONE, soft=0.0), faint])
    known = opacities(scene)
    assert known is not None and known == [entry.opacity for entry in clearest_entries(scene.plane.patches)]
    assert [round(known[n], 9) for n in (10, 80, 120, 160, 255)] == [0.0, 0.1, 0.0, 0.8, 0.8]
    assert clearest_entries(scene.plane.patches)[80].refl == (0.0, 0.0, 1.0)
    assert 153 < edge_of_table(scene) < 154  # where the bone begins


def test_an_image_that_shows_nothing_of_it_says_why() -> None:
    import numpy as np

    assert "patch" in why_empty(np.zeros((2, 2, 4), np.float32), PLAIN.with_(patches=[BONE]))


def test_movies_pass_between_patches() -> None:
    first = msgspec.structs.replace(BONE, opacity=0.2, density=(0.2, 1.0))
    last = msgspec.structs.replace(BONE, opacity=0.4, density=(0.6, 1.0))
    scenes = key_framed([PLAIN.with_(patches=[patch]) for patch in (first, last)], GEOMETRY, 3)
    (middle,) = scenes[1].plane.patches
    assert math.isclose(middle.opacity, 0.3) and middle.density == pytest.approx((0.4, 1.0))
    assert middle.top == BONE.top
