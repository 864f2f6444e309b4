"""VTK is made to draw the same scene: a smooth body looks alike, from every side and in every geometry."""

from pathlib import Path

import msgspec
import pytest
import torch
from torch import Tensor

from tolerances import ALIKE_SMOOTH, UNLIKE_MIRRORED
from volsplat.bench.ssim import luminance, ssim
from volsplat.bench.views import seen
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.scene import Bounds, Light, Quantise, Scene, Shading
from volsplat.protocol.description.shading_tables import ColourTable, CrossBar, Field, ScalarTable, Tables
from volsplat.protocol.description.view_rotation import rotation_from_angles
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry.matrices import Matrix
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.text.errors import BadInput

try:
    from volsplat.bench.peers.vtk_scene import VtkScene, placed
except ImportError:
    pytest.skip("VTK is not installed: install the extra [bench]", allow_module_level=True)

SIZE = (160, 160)
ROTATION = rotation_from_angles(30, 20, 10)

UPRIGHT: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
STRETCHED: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.3, 0.0), (0.0, 0.0, 0.8))
TURNED: Matrix = ((0.0, -1.0, 0.0), (0.6, 0.0, 0.8), (-0.8, 0.0, 0.6))
LEFT_HANDED: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0))
SKEWED: Matrix = ((1.0, 0.3, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def body() -> Tensor:
    """Three smooth balls of unlike size that no mirror maps onto themselves: float32 (k, j, i), 0..1."""
    k, j, i = torch.meshgrid(*(torch.arange(n).float() for n in (40, 44, 48)), indexing="ij")
    values = torch.zeros_like(i)
    for (ci, cj, ck), radius in (((24, 22, 20), 11.0), ((36, 30, 24), 7.0), ((22, 10, 30), 5.0)):
        distance = torch.sqrt((i - ci) ** 2 + (j - cj) ** 2 + (k - ck) ** 2)
        values = torch.maximum(values, (1.5 - distance / radius).clamp(0, 1))
    return values


def scene(**shading: bool) -> Scene:
    return Scene(
        tables=Tables(
            emit=ColourTable(points=((0.0, (0.2, 0.1, 0.1)), (1.0, (0.2, 0.3, 0.1)))),
            refl=ColourTable(points=((0.0, (0.6, 0.5, 0.5)),)),
            opac=ScalarTable(points=((0.0, 0.0), (0.2, 0.0), (0.9, 0.3), (1.0, 0.3))),
        ),
        shading=Shading(**{"modulation": False, **shading}),
        light=Light(direction=(0.5, 0.3, 1.0)),
        quantise=Quantise(window=(0.0, 1.0)),
    )


def both(folder: Path, shown: Scene, matrix: Matrix = UPRIGHT, fixed_to: str = "world") -> tuple[Tensor, Tensor]:
    """The luminance of our picture and of VTK's."""
    geometry = Geometry(body().shape[::-1], matrix)  # type: ignore[arg-type]
    write_volume(folder / "body.nrrd", body(), geometry)
    shown = seen(shown, geometry, ROTATION, SIZE)
    shown = msgspec.structs.replace(shown, light=msgspec.structs.replace(shown.light, fixed_to=fixed_to))
    with SingleProcess(folder / "body.nrrd") as single:
        own = single.render(shown)
        vtk = VtkScene(placed(body(), geometry), shown, single.volume.quantisation(shown.quantise), 0.25, 1)
    vtk.draw(shown)
    return luminance(own), luminance(vtk.picture())


@pytest.mark.parametrize("fixed_to", ["world", "grid"])
@pytest.mark.parametrize(
    "matrix", [UPRIGHT, STRETCHED, TURNED, LEFT_HANDED], ids=["upright", "stretched", "turned", "left"]
)
def test_a_lit_body_looks_alike_and_its_mirror_image_does_not(tmp_path: Path, matrix: Matrix, fixed_to: str) -> None:
    own, other = both(tmp_path, scene(), matrix, fixed_to)
    assert own.max() > 0.3
    assert ssim(own, other) > ALIKE_SMOOTH
    assert ssim(own.flip(1), other) < UNLIKE_MIRRORED
    assert ssim(own.flip(0), other) < UNLIKE_MIRRORED


@pytest.mark.parametrize(
    "switches",
    [{"diffuse": False, "specular": False}, {"specular": False}, {"emitted": False}, {"two_sided": True}],
    ids=str,
)
def test_each_part_of_the_light_is_vtk_s_as_well(tmp_path: Path, switches: dict[str, bool]) -> None:
    own, other = both(tmp_path, scene(**switches))
    assert ssim(own, other) > ALIKE_SMOOTH


def test_modulation_by_gradient_strength_becomes_gradient_opacity(tmp_path: Path) -> None:
    plain = scene(modulation=True)
    modulated = msgspec.structs.replace(
        plain, tables=msgspec.structs.replace(plain.tables, modu=ScalarTable(points=((0.1, 0.0), (0.6, 1.0))))
    )
    own, other = both(tmp_path, modulated)
    assert ssim(own, other) > ALIKE_SMOOTH


def test_what_vtk_cannot_show_is_refused_in_one_line() -> None:
    geometry = Geometry((48, 44, 40), SKEWED)
    with pytest.raises(BadInput, match="skewed"):
        placed(body(), geometry)
    upright = placed(body(), Geometry((48, 44, 40)))
    quantisation = Quantisation(window=(0.0, 1.0), strength_scale=100.0)
    by_depth = msgspec.structs.replace(scene(), cross_bar=CrossBar(emit=Field.SCREEN_Z))
    clipped = msgspec.structs.replace(scene(), bounds=Bounds(low=(1, 0, 0)))
    for shown, cause in ((by_depth, "screen-z"), (clipped, "whole volumes")):
        with pytest.raises(BadInput, match=cause):
            VtkScene(upright, shown, quantisation, 1.0, 1)
