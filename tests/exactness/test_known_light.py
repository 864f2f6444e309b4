"""Ramps, whose normal is known: Lambert and Blinn by hand, on every kind of grid."""

import math

import msgspec
import pytest
import torch
from torch import Tensor

from support.scenes.arbitrary import plain_scene
from support.scenes.rays import MATRICES, OBLIQUE, constant
from support.scenes.rendering import rendered
from tolerances import CODED_DIRECTION, ONE_LEVEL, ROUNDED_COLOUR
from volsplat.protocol.description.refinement_steps import PaperStep, Step
from volsplat.protocol.description.scene import Light, Refine, Scene, Shading, View
from volsplat.protocol.description.shading_tables import ColourTable, ScalarTable, Tables
from volsplat.protocol.description.view_rotation import rotation_from_angles
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Vector, rotation_from_quaternion
from volsplat.protocol.rules.resolved_view import screen_rotation
from volsplat.protocol.rules.shading_rule import shading_rule


def lit_scene(
    view: View,
    light: Light,
    power: float = 8.0,
    two_sided: bool = False,
    diffuse: bool = True,
    specular: bool = True,
) -> Scene:
    black = ColourTable(points=((0.0, (0.0, 0.0, 0.0)),))
    reflected = ColourTable(points=((0.0, (0.5, 0.3, 0.1)),))
    return msgspec.structs.replace(
        plain_scene(view=view, size=(24, 24)),
        tables=Tables(emit=black, refl=reflected, opac=ScalarTable(points=((0.0, 1.0),))),
        light=light,
        shading=Shading(diffuse=diffuse, specular=specular, specular_power=power, two_sided=two_sided),
        refine=Refine(lit_from=PaperStep.A),
    )


def ramp(geometry: Geometry, slope: Vector) -> Tensor:
    """128 in the middle, rising by `slope` per unit of physical length along x, y and z."""
    ni, nj, nk = geometry.dims
    k, j, i = torch.meshgrid(*(torch.arange(n).double() - (n - 1) / 2 for n in (nk, nj, ni)), indexing="ij")
    physical = torch.stack((i, j, k), dim=-1) @ torch.tensor(geometry.index_to_physical, dtype=torch.float64).T
    return 128 + physical @ torch.tensor(slope, dtype=torch.float64)


def lambert_and_blinn(
    normal: Tensor, light: Tensor, power: float, two_sided: bool, diffuse: bool, specular: bool
) -> float:
    """All vectors along screen axes; the eye is on +z."""
    light = light / light.norm()
    half = light + torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    cosine, between = float(light @ normal), float(half / half.norm() @ normal)
    if two_sided:
        cosine, between = abs(cosine), abs(between)
    shine = max(0.0, between) ** power if cosine > 0 and specular else 0.0
    return (max(0.0, cosine) if diffuse else 0.0) + shine


@pytest.mark.parametrize("matrix", MATRICES)
@pytest.mark.parametrize("fixed_to", ["world", "grid"])
@pytest.mark.parametrize(
    "switches", [(False, True, True), (True, True, True), (False, True, False), (False, False, True)]
)
@pytest.mark.parametrize("slope", [(0.0, 0.0, -3.0), (2.0, 0.0, 0.0), (-1.0, -2.0, 0.5)])
@pytest.mark.parametrize("step", [Step.C, Step.F])
def test_a_lit_ramp_has_the_light_of_its_known_normal(
    matrix: str, fixed_to: str, switches: tuple[bool, bool, bool], slope: Vector, step: Step
) -> None:
    two_sided, diffuse, specular = switches
    geometry = Geometry((9, 9, 9), MATRICES[matrix])
    direction = (0.5, 0.4, 0.9)
    light = Light(direction=direction, fixed_to="world" if fixed_to == "world" else "grid")
    view = View(rotation=OBLIQUE, zoom=3.0)
    scene = lit_scene(view, light, 8.0, two_sided, diffuse, specular)
    rotation = torch.tensor(rotation_from_quaternion(OBLIQUE), dtype=torch.float64)
    outward = -torch.tensor(slope, dtype=torch.float64)
    normal = rotation @ (outward / outward.norm())
    towards = torch.tensor(direction, dtype=torch.float64)
    if fixed_to == "grid":
        towards = rotation @ towards
    expected = lambert_and_blinn(normal, towards, 8.0, two_sided, diffuse, specular)
    pixel = rendered(ramp(geometry, slope), geometry, scene, step)[12, 12]
    assert float(pixel[3]) == pytest.approx(1, abs=ONE_LEVEL)
    colour = torch.tensor([0.5, 0.3, 0.1], dtype=torch.float64) * expected
    assert (pixel[:3] / pixel[3] - colour.clamp(max=1)).abs().max() <= CODED_DIRECTION


def test_a_surface_that_faces_away_from_the_light_is_dark_unless_two_sided() -> None:
    geometry = Geometry((9, 9, 9))
    values = ramp(geometry, (0.0, 0.0, 3.0))  # rises to the viewer: its outward normal points away
    light = Light(direction=(0.2, 0.1, 1.0))
    view = View(zoom=3.0)
    assert not rendered(values, geometry, lit_scene(view, light), Step.F)[..., :3].any()
    assert rendered(values, geometry, lit_scene(view, light, two_sided=True), Step.F)[12, 12, 0] > 0.4


def test_where_there_is_no_gradient_there_is_no_light() -> None:
    geometry = Geometry((9, 9, 9))
    scene = lit_scene(View(zoom=3.0), Light(direction=(0.0, 0.0, 1.0)))
    image = rendered(constant(geometry.dims, 90.0), geometry, scene, Step.F)
    assert not image[..., :3].any()
    assert image[12, 12, 3] > 0.9


def test_beside_nan_gradients_are_one_sided() -> None:
    geometry = Geometry((9, 9, 9))
    values = ramp(geometry, (0.0, 0.0, -3.0))
    light = Light(direction=(0.3, 0.2, 1.0))
    scene = lit_scene(View(zoom=3.0), light)
    whole = rendered(values, geometry, scene, Step.C)[12, 12]
    values[6:] = math.nan  # the viewer's side
    cut = rendered(values, geometry, scene, Step.C)[12, 12]
    assert (whole - cut).abs().max() <= ROUNDED_COLOUR


@pytest.mark.parametrize("angles", [(0, 0), (90, 0), (180, 0), (180, 90), (30, 20), (-75, 11)])
@pytest.mark.parametrize("fixed_to", ["grid", "world"])
def test_light_from_right_behind_reflects_nothing_to_the_eye(angles: tuple[float, float], fixed_to: str) -> None:
    """Though rounding leaves something of the sum of the two directions."""
    view = View(rotation=rotation_from_angles(*angles))
    behind = (0.0, 0.0, -1.0)
    if fixed_to == "grid":
        behind = matrices.applied(matrices.transposed(screen_rotation(view)), behind)
    scene = lit_scene(view, msgspec.convert({"direction": behind, "fixed_to": fixed_to}, Light))
    assert shading_rule(scene, Step.F).lighting.half_way == (0.0, 0.0, 0.0)
