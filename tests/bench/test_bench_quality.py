"""What pictures are judged by: the ray caster and its fields against closed forms, and the measures on known input."""

import math
from importlib.util import find_spec
from pathlib import Path

import pytest
import torch
from torch import Tensor

from support.programs.programs import Person
from tolerances import EXACT_RAYS, ROUNDING, SLOPE_BY_DIFFERENCES
from volsplat.bench.commands.command import bench
from volsplat.bench.quality.density_fields import KnownSignal, SplineField, marschner_lobb_field
from volsplat.bench.quality.lit_scenes import WHOLE_RANGE, grey_scene, signal_view, viewed
from volsplat.bench.quality.ray_caster import cast
from volsplat.bench.quality.rings import peak, spectrum, strongest
from volsplat.bench.quality.turn import greatest_jump
from volsplat.bench.quality.uniform_slab import absorbed
from volsplat.bench.tables.record import read_record
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.centred_grid import centred_geometry
from volsplat.client.scene.table_makers import scalars
from volsplat.program import extras
from volsplat.protocol.description.shading_tables import ScalarTable
from volsplat.protocol.description.view_rotation import rotation_from_angles
from volsplat.protocol.text.errors import BadInput

SIZE = (9, 8, 7)
FRONT = rotation_from_angles(0, 0)
WINDOW = (0.0, 1.0)


def noise() -> Tensor:
    return torch.rand(SIZE[::-1], generator=torch.Generator().manual_seed(1), dtype=torch.float64)


def places(count: int) -> Tensor:
    drawn = torch.rand((count, 3), generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    return drawn * (torch.tensor(SIZE) - 1)


def ramp(along: int) -> KnownSignal:
    """Rises from 0 to 1 along an axis of a cubic grid of 9 voxels."""
    return KnownSignal(lambda *xyz: xyz[along] / 8 + 0.5, 1 / 8, centred_geometry((9, 9, 9), (1.0, 1.0, 1.0)))


def test_a_spline_passes_through_all_voxels_and_keeps_within_its_bounds() -> None:
    values = noise()
    field = SplineField(values)
    k, j, i = torch.meshgrid(*map(torch.arange, values.shape), indexing="ij")
    voxels = torch.stack((i, j, k), dim=-1).reshape(-1, 3).double()
    assert (field.density(voxels) - values.flatten()).abs().max() < ROUNDING
    middle = places(300)
    low, high = field.bounds(middle)
    for moved in (torch.zeros(3), torch.full((3,), 0.5), torch.tensor((-0.5, 0.5, -0.5))):
        density = field.density((middle + moved).clamp(torch.zeros(3), torch.tensor(SIZE) - 1.0))
        assert bool(((low <= density) & (density <= high)).all())


def test_a_spline_is_as_good_as_a_cubic_in_the_middle() -> None:
    at = torch.arange(40.0, dtype=torch.float64)
    field = SplineField((at**3 / 64000)[None, None, :].expand(3, 3, 40))
    x = torch.linspace(17, 22, 50, dtype=torch.float64)
    where = torch.stack((x, torch.ones_like(x), torch.ones_like(x)), dim=-1)
    assert (field.density(where) - x**3 / 64000).abs().max() < ROUNDING


@pytest.mark.parametrize("field", [SplineField(noise()), marschner_lobb_field(make_phantom("marschner-lobb")[1])])
def test_gradients_are_the_slopes_of_densities(field: SplineField | KnownSignal) -> None:
    where, step = places(50) + 0.01, 1e-5
    for axis in range(3):
        moved = torch.zeros(3, dtype=torch.float64)
        moved[axis] = step
        slope = (field.density(where + moved) - field.density(where - moved)) / (2 * step)
        assert (field.gradient(where)[:, axis] - slope).abs().max() < SLOPE_BY_DIFFERENCES


def test_the_signal_between_the_voxels_is_that_of_the_phantom_at_them() -> None:
    values, geometry = make_phantom("marschner-lobb")
    field = marschner_lobb_field(geometry)
    k, j, i = torch.meshgrid(*(torch.arange(0, 41, 5),) * 3, indexing="ij")
    density = field.density(torch.stack((i, j, k), dim=-1).reshape(-1, 3).double())
    assert (density - values[::5, ::5, ::5].flatten()).abs().max() < EXACT_RAYS


def test_a_ray_through_fog_is_beer_s_law() -> None:
    scene = viewed(grey_scene(scalars((0.0, 0.3), (1.0, 0.3)), WHOLE_RANGE), FRONT, 4.0, (8, 8))
    image = cast(ramp(1), ramp(1).geometry, scene, WINDOW, 1 / 8)
    assert (image[..., 3] - (1 - 0.7**9)).abs().max() < EXACT_RAYS
    assert absorbed(image) == pytest.approx(-64 * 9 * math.log(0.7), rel=EXACT_RAYS)


def test_light_is_that_of_the_slope_s_angle() -> None:
    """A ramp that falls towards the viewer: its normal points at him, so the light's cosine is known."""
    scene = viewed(grey_scene(scalars((0.0, 1.0)), WHOLE_RANGE), FRONT, 4.0, (8, 8))
    image = cast(ramp(1), ramp(1).geometry, scene, WINDOW, 1 / 8)
    x, y, z = scene.light.direction
    cosine = z / math.hypot(x, y, z)
    half = math.sqrt((1 + cosine) / 2)
    expected = 0.12 + 0.5 * (cosine + half**scene.shading.specular_power)
    assert (image[..., :3] - expected).abs().max() < EXACT_RAYS


def test_a_ball_is_round_and_in_the_middle_of_the_image() -> None:
    geometry = centred_geometry((17, 17, 17), (1.0, 1.0, 1.0))
    ball = KnownSignal(lambda x, y, z: 1 - torch.sqrt(x * x + y * y + z * z + 1e-9) / 10, 0.1, geometry)
    solid = ScalarTable(points=((0.5, 0.0), (0.5, 1.0)))  # where the distance is less than 5
    scene = viewed(grey_scene(solid, WHOLE_RANGE), rotation_from_angles(30, 20), 3.0, (41, 40))
    alpha = cast(ball, geometry, scene, WINDOW, 1 / 16)[..., 3]
    y, x = torch.meshgrid(torch.arange(40) - 19.5, torch.arange(41) - 20.0, indexing="ij")
    distance = torch.hypot(x, y) / 3
    assert alpha[distance < 4.7].min() > 0.99 and alpha[distance > 5.1].max() == 0.0


def test_what_only_skips_empty_space_changes_nothing() -> None:
    """Against the same field with bounds that let nothing be skipped."""
    values, geometry = make_phantom("marschner-lobb")
    skipping, scene = marschner_lobb_field(geometry), signal_view(0.8)
    blind = KnownSignal(skipping.signal, math.inf, geometry)
    drawn = [cast(field, geometry, scene, WINDOW, 1 / 4) for field in (skipping, blind)]
    assert drawn[0][..., 3].max() > 0.5
    assert (drawn[0] - drawn[1]).abs().max() < ROUNDING


def test_more_samples_change_nothing_that_can_be_seen() -> None:
    _, geometry = make_phantom("marschner-lobb")
    images = [cast(marschner_lobb_field(geometry), geometry, signal_view(0.8), WINDOW, 1 / n) for n in (64, 128)]
    assert (images[0] - images[1]).abs().max() < 1 / 255


def test_waves_down_a_picture_have_their_amplitude_in_its_spectrum() -> None:
    y = torch.arange(120.0, dtype=torch.float64)[:, None].expand(120, 40)
    wave = 0.3 + 0.002 * y + 0.01 * torch.cos(2 * math.pi * y / 6)
    height, beside = peak(spectrum(wave), 6.0)
    assert height == pytest.approx(0.01, rel=0.01) and beside < 0.1 * height
    longer = 0.3 + 0.01 * torch.cos(2 * math.pi * y / 15)
    assert strongest(spectrum(longer), 6.0) == pytest.approx(0.01, rel=0.05)
    assert peak(spectrum(longer), 6.0)[0] < 1e-4


def test_a_jump_is_measured_by_its_neighbours() -> None:
    assert greatest_jump([1.0, 2.0, 3.0, 4.0]) == 1.0
    assert greatest_jump([1.0, 1.0, 1.5, 1.0, 1.0]) == 1.5


@pytest.mark.skipif(find_spec("matplotlib") is None, reason="matplotlib is not installed")
def test_the_command_tells_what_is_reached_and_draws_it(tmp_path: Path) -> None:
    parts = [f"--only={name}" for name in ("check", "marschner-lobb", "slab", "times")]
    sizes = ("--zooms", "1", "--directions", "2", "--images", "32", "--voxels", "16", "--repeats", "1")
    person = Person(tmp_path)
    done = person.runs("bench", "quality", *parts, *sizes, "--json", "q.json", "--markdown", "q.md", "--plot", "q.png")
    assert done.returncode == 0, done.stderr
    found = {one.name: one.median for one in read_record(tmp_path / "q.json").figures}
    assert min(found["Check, soft ball: SSIM of G"], found["Check, soft ball: SSIM of F"]) > 0.99
    assert 0 < found["Marschner-Lobb, zoom 1: SSIM of F"] < found["Marschner-Lobb, zoom 1: SSIM of cubic spline"]
    assert found["Uniform slab, greatest less least: brightness of G"] < 0.005
    taken = [found[f"Time, 32 x 32{words}: milliseconds of G"] for words in ("", ", processor time")]
    assert min(taken) > 0
    assert "above 0.99 | yes |" in (tmp_path / "q.md").read_text(encoding="utf-8")
    refused = person.runs("bench", "quality", "missing.nrrd", "--only", "head")
    assert refused.returncode == 2 and "missing.nrrd" in refused.stderr


def test_a_plot_of_parts_that_have_none_is_refused_before_any_work(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="--plot: none of the parts .* marschner-lobb"):
        bench.main(["quality", "--only", "slab", "--plot", str(tmp_path / "q.png")], standalone_mode=False)


def test_without_vtk_its_columns_are_left_out_and_the_extra_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(extras, "find_spec", lambda name: None if name == "vtkmodules" else find_spec(name))
    bench.main(["quality", "--only", "slab", "--directions", "2"], standalone_mode=False)
    told = capsys.readouterr()
    assert "pip install " in told.err and "'volsplat[bench]'" in told.err
    assert "Uniform slab" in told.out and "VTK" not in told.out
