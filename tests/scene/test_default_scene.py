"""The default scene: whatever the histogram, the first picture shows something, and not everything."""

import math
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
import torch
from hypothesis import example, given
from hypothesis import strategies as st

from volsplat.client.histogram.density_histogram import density_histogram, recognised_ct
from volsplat.client.histogram.subject import subject_of
from volsplat.client.memory.array_volume import Volume
from volsplat.client.scene.default_scene import default_scene
from volsplat.client.scene.histogram_scene import LEAST_SEEN, MOST_SEEN
from volsplat.client.scene.presets import PRESETS, preset_scene
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Image, Scene, View
from volsplat.protocol.description.shading_tables import Field
from volsplat.protocol.description.view_rotation import named_view
from volsplat.protocol.description.volume import Geometry, VolumeDescription
from volsplat.protocol.rules.index_rules import HISTOGRAM_BINS, Survey, density_window
from volsplat.protocol.text.errors import BadInput

SIDE = 64
VOXELS = SIDE**3


def first_scene(values: dict[float, int], scalar_type: str, no_data: int = 0) -> tuple[Scene, float, float]:
    """The default scene of a volume with these values and counts, the share of voxels it shows, and the share of
    the most frequent density byte."""
    low, high = min(values, default=1.0), max(values, default=0.0)
    counts = [0] * HISTOGRAM_BINS
    for value, count in values.items():
        position = (value - low) / (high - low) if high > low else 0.0
        counts[min(int(position * HISTOGRAM_BINS), HISTOGRAM_BINS - 1)] += count
    survey = Survey(low=low, high=high, max_gradient=1.0, voxels=sum(values.values()) + no_data, no_data=no_data)
    window = density_window(survey, counts, scalar_type)
    description = VolumeDescription(
        name="nasty",
        format="test",
        geometry=Geometry(dims=(SIDE, SIDE, SIDE)),
        scalar_type=scalar_type,
    )
    scene = default_scene(subject_of(description, survey, counts, window))
    histogram = density_histogram(survey, counts, window)
    opacity = scene.tables.opac.entries()
    total = max(histogram.voxels, 1)
    shown = sum(count for byte, count in enumerate(histogram.counts) if opacity[byte] > 0)
    return scene, shown / total, max(histogram.counts) / total


ORDINARY = {
    "labels": {0.0: 900, 1.0: 50, 2.0: 30, 29.0: 20},
    "inverted labels": {0.0: 20, 1.0: 30, 5.0: 950},
    "two values": {0.0: 500, 255.0: 500},
    "bright background": {255.0: 800, 100.0: 150, 50.0: 50},
    "a ramp": {float(n): 10 for n in range(256)},
    "padding far below": {-32768.0: 400, -1000.0: 300, 40.0: 250, 1000.0: 50},
    "signed noise": {n / 10: int(1000 * 2.718 ** (-((n / 30) ** 2))) for n in range(-100, 101)},
    "tiny floats": {n * 1e-30: 1000 - n for n in range(1000)},
    "a long tail": {0.0: 10**6, **{float(2**n): 10 ** (6 - n // 3) for n in range(18)}},
    "all negative": {-5.0: 700, -3.0: 200, -1.0: 100},
    "unusual on both sides": {0.0: 8, 128.0: 985, 255.0: 7},
}


EIGHT_BIT = [name for name, values in ORDINARY.items() if all(v in range(256) for v in values)]
CASES = [(name, "uint8") for name in EIGHT_BIT] + [(name, kind) for name in ORDINARY for kind in ("int16", "float32")]


@pytest.mark.parametrize(("name", "scalar_type"), CASES)
def test_the_first_picture_shows_between_one_and_sixty_percent(name: str, scalar_type: str) -> None:
    _, shown, _ = first_scene(ORDINARY[name], scalar_type)
    assert LEAST_SEEN <= shown <= MOST_SEEN


@given(
    values=st.dictionaries(st.floats(-1e6, 1e6) | st.integers(-300, 300).map(float), st.integers(1, 10**6), min_size=1),
    scalar_type=st.sampled_from(["uint8", "int16", "float32"]),
    no_data=st.integers(0, 10**6),
)
@example(values={7.0: VOXELS}, scalar_type="int16", no_data=0)
@example(values={0.0: VOXELS}, scalar_type="uint8", no_data=0)
@example(values={255.0: VOXELS}, scalar_type="uint8", no_data=0)
@example(values={0.0: VOXELS - 1, 1.0: 1}, scalar_type="uint8", no_data=0)
@example(values={3.5: 1}, scalar_type="float32", no_data=VOXELS)
def test_something_is_always_seen_and_not_everything_unless_all_is_alike(
    values: dict[float, int], scalar_type: str, no_data: int
) -> None:
    _, shown, mode = first_scene(values, scalar_type, no_data)
    assert shown > 0
    if mode < 1:
        assert shown <= MOST_SEEN
    if mode <= 1 - LEAST_SEEN:
        assert shown >= LEAST_SEEN


def test_a_volume_of_nothing_but_nan_still_gets_a_scene() -> None:
    scene, shown, _ = first_scene({}, "float32", no_data=VOXELS)
    assert shown == 0
    assert scene.tables.opac.entries()[-1] > 0


def test_data_of_both_signs_shows_both_signs_in_two_colours() -> None:
    scene, _, _ = first_scene(ORDINARY["signed noise"], "float32")
    opacity, emitted = scene.tables.opac.entries(), scene.tables.emit.entries()
    assert opacity[0] > 0 and opacity[127] == 0 and opacity[255] > 0
    assert emitted[0][2] > emitted[0][0] and emitted[255][0] > emitted[255][2]


@given(st.integers(0, VOXELS))
def test_stray_voxels_without_a_value_change_no_light(no_data: int) -> None:
    scene, *_ = first_scene({0.0: VOXELS - no_data, 1.0: VOXELS // 4, 2.0: VOXELS // 8}, "float32", no_data)
    assert scene.shading.two_sided == (no_data > (VOXELS + VOXELS // 4 + VOXELS // 8) / 1000)


def test_data_that_rises_towards_voxels_without_a_value_is_lit_like_what_falls() -> None:
    along = torch.linspace(-1, 1, 24)
    radius = (along[:, None, None] ** 2 + along[:, None] ** 2 + along**2).sqrt()
    brightness = []
    for values in (radius, 2.0 - radius):
        within = torch.where(radius < 0.8, values, math.nan).numpy()
        with SingleProcess(Volume(within, spacing=(1, 1, 1))) as single:
            scene = single.volume.default_scene()
            assert scene.shading.two_sided
            brightness.append(single.render(scene.with_(size=64))[24:40, 24:40, :3].mean())
    assert brightness[0] > 0.7 * brightness[1]


def test_what_is_seen_also_glows() -> None:
    for values in ORDINARY.values():
        scene, _, _ = first_scene(values, "float32")
        for opacity, colour in zip(scene.tables.opac.entries(), scene.tables.emit.entries(), strict=True):
            assert opacity == 0 or max(colour) > 0


# Scans


def ct_of_a_head(air: int = 6000) -> dict[float, int]:
    """Hounsfield units with the peaks of air, fat, soft tissue and bone, and some of all between."""
    peaks = ((-1000, 12, air), (-100, 12, 150), (40, 12, 2500), (900, 200, 120))
    values = range(-1024, 1500)
    return {
        float(v): int(1 + sum(n * math.exp(-0.5 * ((v - at) / wide) ** 2) for at, wide, n in peaks)) for v in values
    }


def test_a_ct_is_shown_by_its_surfaces_air_clear_flesh_faint_and_bone_solid() -> None:
    scene, shown, _ = first_scene(ct_of_a_head(), "int16")
    assert LEAST_SEEN <= shown <= MOST_SEEN
    assert scene.shading.modulation and scene.cross_bar.modu is Field.STRENGTH
    low, high = -1024.0, 1500.0
    air, flesh, bone = (
        scene.tables.opac.entries()[round((hounsfield - low) / (high - low) * 255)] for hounsfield in (-1000, 40, 600)
    )
    assert air == 0 < flesh < 0.5 < bone


def test_a_ct_that_fills_its_grid_still_shows_no_more_than_sixty_percent() -> None:
    _, shown, _ = first_scene(ct_of_a_head(air=1000), "int16")
    assert LEAST_SEEN <= shown <= MOST_SEEN


@pytest.mark.parametrize("name", ORDINARY)
def test_what_is_no_ct_is_seen_from_the_front_without_modulation(name: str) -> None:
    scene, _, _ = first_scene(ORDINARY[name], "float32")
    assert scene.view.rotation == named_view("front") and not scene.shading.modulation


@pytest.mark.parametrize("head", ["ct_head_96x128x113", "cthead_256x256x113"])
def test_the_real_heads_start_upright_with_and_without_a_preset(shared_data: Path, head: str) -> None:
    volume = SingleProcess(shared_data / "ct_head" / f"{head}.nrrd").volume
    views = {volume.default_scene().view}
    views |= {preset_scene(name, volume.subject()).view for name in PRESETS}
    assert views == {View(rotation=named_view("front"))} and volume.stands_up.up == "-z"


@pytest.mark.parametrize(
    ("file", "is_ct"),
    [
        ("nifti/CT_pitch.nii.gz", True),
        ("dicom_ct_phantom", True),
        ("volvis/tooth_103x94x161_uint8.nhdr", False),  # one, but with no scale of a body
        ("volvis/nucleon_41x41x41_uint8.nhdr", False),
        ("volvis/neghip_64x64x64_uint8.nhdr", False),
        ("metaimage/HeadMRVolume.mhd", False),
        ("nrrd/template_T2.nrrd", False),
        ("nifti/avg152T1_LR_nifti.nii.gz", False),
        ("nifti/big.nii.gz", False),
        ("sod/sod_density_97x97x116.nhdr", False),
    ],
)
def test_only_scans_of_bodies_count_as_ct(shared_data: Path, file: str, is_ct: bool) -> None:
    volume = SingleProcess(shared_data / file).volume
    assert (recognised_ct(volume.density_histogram()) is not None) == is_ct


@pytest.mark.parametrize(
    "file", ["ct_head/ct_head_96x128x113.nrrd", "volvis/tooth_103x94x161_uint8.nhdr", "nrrd/template_T2.nrrd"]
)
def test_the_first_picture_has_a_solid_object(shared_data: Path, file: str) -> None:
    """Where anything lies in front of the background, it is a surface and no fog."""
    with SingleProcess(shared_data / file) as single:
        scene = msgspec.structs.replace(single.volume.default_scene(), image=Image(width=128, height=128))
        alpha = single.render(scene)[..., 3]
    assert (alpha > 0.9).sum() > 0.6 * (alpha > 0.02).sum()


def test_each_label_has_a_colour_of_its_own_and_the_background_none() -> None:
    scene, shown, _ = first_scene(ORDINARY["labels"], "uint8")
    emitted, opacity = scene.tables.emit.entries(), scene.tables.opac.entries()
    assert len({emitted[label] for label in (1, 2, 29)}) == 3
    assert opacity[0] == 0 and opacity[1] == opacity[2] == opacity[29] > 0.5
    assert shown == 0.1


def colours_each(scene: Scene, position: Callable[[float], float], high: int) -> bool:
    """Whether the scene has a colour for each of the whole numbers from 0 up."""
    places = [place for place, _ in scene.tables.refl.points]
    return len(places) == high + 1 and places == pytest.approx([position(n) for n in range(high + 1)])


@given(st.integers(1, 40), st.integers(0, 120), st.booleans())
@example(high=21, background=0, whole=True)  # counts of photons
@example(high=21, background=100, whole=True)
@example(high=1, background=40, whole=True)  # a mask
def test_step_g_is_refused_for_what_is_shown_as_more_than_two_labels_and_for_no_other_volume(
    high: int, background: int, whole: bool
) -> None:
    numbers = torch.arange(5**3)
    values = torch.where(numbers < background, 0, numbers % (high + 1))
    values[-1] = high
    placed = Volume(values.reshape(5, 5, 5).to(torch.uint8 if whole else torch.float32), axes="zyx", spacing=(1, 1, 1))
    with SingleProcess(placed) as single:
        scene = single.volume.default_scene()
        single.volume.check_step(Step.F)
        mixed = colours_each(scene, single.volume.density_histogram().position, high) and len(set(values.tolist())) > 2
        assert single.volume.has(Step.G) is not mixed
        if mixed:
            with pytest.raises(BadInput, match=f"whole numbers 0 to {high}, which are shown as labels .*; draw step F"):
                single.finish(scene, Step.G)


def test_step_g_is_refused_for_few_labels_and_not_for_counts_nor_a_mask() -> None:
    def has_g(values: torch.Tensor) -> bool:
        with SingleProcess(Volume(values.to(torch.uint8), axes="zyx", spacing=(1, 1, 1))) as single:
            return single.volume.has(Step.G)

    numbers = torch.arange(8**3).reshape(8, 8, 8)
    assert not has_g((numbers % 20).clamp(max=4) * (numbers % 2))
    assert has_g(numbers % 22)
    assert has_g(numbers < 100)
