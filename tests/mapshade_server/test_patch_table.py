"""The 2-D table over density and strength: the kernel against the reference, and what it looks like by itself."""

import pytest
import torch
from hypothesis import given
from torch.utils.dlpack import from_dlpack

from reference.plane import PlaneTable, plane_table
from support.scenes.arbitrary import plain_scene
from support.scenes.shadings import patches
from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.frames import shading_tables
from volsplat.protocol.description.patches import Patch, Patches, greatest_opacity
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.rules.shading_rule import shading_rule

EXACT = 1e-12
FLOAT32 = 1e-6


def table_of(drawn: Patches) -> PlaneTable:
    """The kernel's, in the reference's form."""
    made = _kernels.PatchTable([patch.numbers for patch in drawn])
    emit, refl = (from_dlpack(of)[:, :3].reshape(256, 256, 3).double() for of in (made.emit, made.refl))
    return PlaneTable(from_dlpack(made.opacity).reshape(256, 256), emit, refl)


@given(drawn=patches())
def test_it_is_that_of_the_reference(drawn: Patches) -> None:
    made, expected = table_of(drawn), plane_table(drawn)
    assert (made.opacity - expected.opacity).abs().max() <= EXACT
    assert made.opacity.max() <= greatest_opacity(drawn) + EXACT
    seen = expected.opacity > EXACT
    for got, wanted in ((made.emit, expected.emit), (made.refl, expected.refl)):
        assert not seen.any() or (got - wanted)[seen].abs().max() <= FLOAT32


@given(drawn=patches())
def test_what_can_be_seen_is_seen_by_both_bytes(drawn: Patches) -> None:
    opacity = plane_table(drawn).opacity > EXACT
    densities, strengths = _kernels.PatchTable([patch.numbers for patch in drawn]).seen()
    for found, there in ((densities, opacity.any(dim=0)), (strengths, opacity.any(dim=1))):
        assert set(torch.nonzero(there).flatten().tolist()) <= set(found)


def test_a_hard_rectangle_is_what_lies_within() -> None:
    patch = Patch(density=(51 / 255, 102 / 255), strength=(10 / 255, 20 / 255), soft=0.0, opacity=0.25)
    opacity = table_of((patch,)).opacity
    assert opacity[10:21, 51:103].eq(0.25).all()
    assert opacity.count_nonzero() == 11 * 52


def test_a_side_at_the_end_of_the_plane_has_no_rim() -> None:
    opacity = table_of((Patch(density=(0.5, 1.0), strength=(0.0, 1.0), soft=1.0, opacity=1.0),)).opacity
    assert opacity[0].tolist() == opacity[255].tolist()
    assert opacity[0, 255] == 1.0 and 0.0 < opacity[0, 130] < 0.1


def test_patches_that_overlap_let_pass_what_both_would_and_mix_their_colours() -> None:
    red = Patch(density=(0.0, 1.0), soft=0.0, opacity=0.5, refl=(1.0, 0.0, 0.0))
    blue = Patch(density=(0.0, 1.0), soft=0.0, opacity=0.25, refl=(0.0, 0.0, 1.0))
    one, other = table_of((red, blue)), table_of((blue, red))
    assert one.opacity[7, 9] == pytest.approx(1 - 0.5 * 0.75)
    assert one.refl[7, 9].tolist() == pytest.approx([2 / 3, 0.0, 1 / 3])
    assert torch.equal(one.opacity, other.opacity)


def test_colours_change_no_table_of_opacities() -> None:
    rules = [
        shading_tables.opacity_rule(
            shading_rule(plain_scene().with_(patches=[{"density": (0.2, 0.4), "refl": refl}]), Step.F)
        )
        for refl in ("white", "red")
    ]
    assert shading_tables.opacity_codes(rules[0], 1.0) is shading_tables.opacity_codes(rules[1], 1.0)
