"""Presets: each finds what it is named after in the histograms that real scans have."""

import math
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tolerances import ONE_BYTE
from volsplat.client.histogram.density_histogram import (
    ASSUMED_AIR,
    ASSUMED_TISSUE,
    LAST,
    CtScale,
    DensityHistogram,
    ct_scale,
    density_histogram,
    landmarks,
    otsu_byte,
    recognised_ct,
    window_of_shares,
    zero_position,
)
from volsplat.client.histogram.subject import Subject
from volsplat.client.scene.presets import PRESETS, fits, preset_scene
from volsplat.client.scene.suited import why_unsuited
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.scene import Scene, View
from volsplat.protocol.description.shading_tables import CrossBar, Field
from volsplat.protocol.description.view_rotation import named_view
from volsplat.protocol.rules.index_rules import HISTOGRAM_BINS, Survey
from volsplat.protocol.text.errors import BadInput

AIR, FAT, TISSUE, BONE = -1000, -100, 40, 1000  # Hounsfield units


def ct_histogram(per_unit: float, offset: float, window: tuple[float, float], noise: float = 12.0) -> DensityHistogram:
    """A head's histogram where values are `per_unit` times HU plus `offset`: peaks, and some of all between."""
    low, high = offset + per_unit * -1024, offset + per_unit * 2200
    counts = [0] * HISTOGRAM_BINS
    for n in range(0, HISTOGRAM_BINS, 16):
        hounsfield = (low + (n + 0.5) / HISTOGRAM_BINS * (high - low) - offset) / per_unit
        share = 2.0 + (AIR < hounsfield < TISSUE)
        for peak, weight in ((AIR, 6000), (FAT, 300), (TISSUE, 2500), (BONE, 60)):
            width = noise * (6 if peak == BONE else 1)
            share += weight * math.exp(-0.5 * ((hounsfield - peak) / width) ** 2)
        counts[n] = int(share)
    survey = Survey(low=low, high=high, max_gradient=1.0, voxels=sum(counts), no_data=0)
    return density_histogram(survey, counts, window)


SCANS: dict[str, tuple[DensityHistogram, Callable[[float], float]]] = {
    "8-bit, value / 10": (ct_histogram(0.1, 102.4, (0.0, 255.0)), lambda hu: (hu / 10 + 102.4) / 255),
    "16-bit, HU + 1024": (ct_histogram(1.0, 1024.0, (0.0, 2500.0)), lambda hu: (hu + 1024) / 2500),
    "signed, HU": (ct_histogram(1.0, 0.0, (-1020.0, 1800.0)), lambda hu: (hu + 1020) / 2820),
}


CT_PRESETS = ["ct-skin", "ct-bone", "surfaces", "ct-soft-tissue", "ct-lung", "ct-angio"]
SHOWS_BELOW_ZERO = ("seismic", "difference-map", "labels")  # or each value but 0: air, too


def opacity_at(scene: Scene, position: float) -> float:
    return scene.tables.opac.entries()[round(min(max(position, 0.0), 1.0) * LAST)]


@pytest.mark.parametrize("scan", SCANS)
def test_a_ct_is_calibrated_by_its_air_and_tissue_peaks(scan: str) -> None:
    histogram, position = SCANS[scan]
    scale = ct_scale(histogram)
    assert round(scale.position(TISSUE) * LAST) == pytest.approx(position(TISSUE) * LAST, abs=ONE_BYTE)
    assert round(scale.position(AIR) * LAST) == pytest.approx(position(AIR) * LAST, abs=ONE_BYTE)
    assert recognised_ct(histogram) == scale


@pytest.mark.parametrize("window", [(1200.0, 2400.0), (900.0, 1100.0), (-500.0, 4000.0), (2400.0, 2500.0)])
def test_a_ct_is_calibrated_alike_under_any_window(window: tuple[float, float]) -> None:
    """Also if there is no peak left in it."""
    usual = Subject(ct_histogram(1.0, 1024.0, (0.0, 2500.0)))
    known = Subject(ct_histogram(1.0, 1024.0, window), usual=usual)
    low, high = window
    for scale in (known.ct, known.ct_or_peaks):
        assert scale is not None
        for hounsfield in (AIR, TISSUE, BONE):
            expected = usual.ct_or_peaks.place(hounsfield) * 2500.0
            assert low + scale.place(hounsfield) * (high - low) == pytest.approx(expected)


@pytest.mark.parametrize("scan", SCANS)
def test_the_skin_preset_shows_the_boundary_of_air_and_tissue_and_no_air(scan: str) -> None:
    histogram, position = SCANS[scan]
    scene = preset_scene("ct-skin", Subject(histogram))
    assert opacity_at(scene, position(AIR)) == 0
    assert opacity_at(scene, position(-200)) > 0.8
    assert opacity_at(scene, position(BONE)) == 0
    assert scene.cross_bar.modu is Field.STRENGTH and scene.shading.modulation


@pytest.mark.parametrize("scan", SCANS)
def test_the_bone_preset_shows_bone_and_no_soft_tissue_in_ivory(scan: str) -> None:
    histogram, position = SCANS[scan]
    scene = preset_scene("ct-bone", Subject(histogram))
    for clear in (AIR, -500, FAT, TISSUE, 100):
        assert opacity_at(scene, position(clear)) == 0
    assert opacity_at(scene, position(400)) > 0.5
    for red, green, blue in scene.tables.refl.entries():
        assert 0.5 < blue < green < red


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("scan", [None, *SCANS])
def test_every_preset_shows_some_of_a_scan_but_not_its_air(name: str, scan: str | None) -> None:
    histogram = SCANS[scan][0] if scan else None
    scene = preset_scene(name, Subject(histogram) if histogram else None)
    opacity = scene.tables.opac.entries()
    assert max(opacity) > 0
    if histogram is not None and name not in SHOWS_BELOW_ZERO and not (name == "orbital" and zero_position(histogram)):
        assert opacity[round(ct_scale(histogram).air * LAST)] == 0


@pytest.mark.parametrize("name", PRESETS)
@given(data=st.data())
def test_every_preset_takes_any_histogram(name: str, data: st.DataObject) -> None:
    counts = data.draw(st.dictionaries(st.integers(0, LAST), st.integers(1, 10**9), max_size=6))
    low = data.draw(st.floats(-1e5, 1e5))
    width = data.draw(st.floats(1e-3, 1e6))
    histogram = DensityHistogram((low, low + width), tuple(counts.get(byte, 0) for byte in range(LAST + 1)))
    known = Subject(histogram, kind=data.draw(st.sampled_from(Kind)))
    scene = preset_scene(name, known)
    assert all(0 <= opacity <= 1 for opacity in scene.tables.opac.entries())


def test_the_papers_cross_bars_are_used() -> None:
    bars = {name: preset_scene(name).cross_bar for name in PRESETS}
    assert bars["surfaces"].modu is Field.STRENGTH
    assert bars["depth-cue"].modu is Field.SCREEN_Z
    assert bars["molecules"] == CrossBar(emit=Field.STRENGTH, refl=Field.DENSITY)
    assert bars["structure-factors"].emit is Field.STRENGTH
    assert bars["galaxy"].emit is Field.GRID_K


def test_atoms_are_grey_blue_red_and_yellow_with_rising_density() -> None:
    points = preset_scene("atoms").tables.refl.points
    carbon, nitrogen, oxygen, sulphur = (points[n][1] for n in (0, 2, 4, 6))
    assert max(carbon) == min(carbon) and max(nitrogen) == nitrogen[2] and max(oxygen) == oxygen[0]
    assert min(sulphur) == sulphur[2] and min(sulphur[:2]) > 2 * sulphur[2]


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_of_a_scan_is_seen_from_the_front(name: str) -> None:
    for known in (None, *(Subject(scan[0]) for scan in SCANS.values())):
        assert preset_scene(name, known).view == View(rotation=named_view("front"))


def test_a_preset_is_found_whatever_the_case_and_one_that_is_not_there_is_refused_with_what_was_meant() -> None:
    assert PRESETS["CT-Bone"] is PRESETS["ct-bone"] and PRESETS.name_of(PRESETS["CT-Bone"]) == "ct-bone"
    with pytest.raises(BadInput, match=r"there is no preset ct-skni \(did you mean ct-skin\?\)"):
        preset_scene("ct-skni")
    with pytest.raises(BadInput, match=r"there is no preset 17 \(choose from ct-skin, ct-bone, surfaces"):
        preset_scene("17")


def test_every_preset_tells_what_it_is_in_one_line() -> None:
    for preset in PRESETS.values():
        assert preset.description and "\n" not in preset.description
        assert preset.source


def test_otsu_splits_two_peaks_in_the_middle_of_their_gap() -> None:
    counts = [0.0] * (LAST + 1)
    counts[10], counts[210] = 300.0, 100.0
    assert otsu_byte(counts) == (10 + 209) // 2


def test_bytes_are_counted_as_voxels_are_quantised() -> None:
    counts = [0] * HISTOGRAM_BINS
    for value in range(101):
        counts[min(value * HISTOGRAM_BINS // 100, HISTOGRAM_BINS - 1)] = 1
    survey = Survey(low=0, high=100, max_gradient=1.0, voxels=101, no_data=0)
    histogram = density_histogram(survey, counts, (20.0, 70.0))
    assert histogram.counts[0] == 21 and histogram.counts[LAST] == 31
    assert histogram.voxels == 101
    assert histogram.counts[round((45 - 20) * LAST / 50)] == 1


def test_values_too_near_each_other_for_a_scale_are_refused() -> None:
    survey = Survey(low=0.0, high=1e-320, max_gradient=0.0, voxels=2, no_data=0)
    with pytest.raises(BadInput, match="too little to tell apart; scale them up"):
        density_histogram(survey, [1] + [0] * (HISTOGRAM_BINS - 2) + [1], (0.0, 1e-320))


def test_without_a_histogram_landmarks_stand_in() -> None:
    assert ct_scale(None) == CtScale(ASSUMED_AIR, ASSUMED_TISSUE)
    assert landmarks(None).background < landmarks(None).object < landmarks(None).core
    assert zero_position(None) is None


@pytest.mark.parametrize(
    ("file", "per_unit"), [("ct_head/ct_head_96x128x113.nrrd", 0.1), ("ct_head/cthead_256x256x113.nrrd", 1.0)]
)
def test_the_real_heads_show_their_skin_and_their_bone(shared_data: Path, file: str, per_unit: float) -> None:
    histogram = SingleProcess(shared_data / file).volume.density_histogram()
    scale = ct_scale(histogram)
    assert scale.air < histogram.position(100 * per_unit)  # the data's own description: air 0..100, tissue about 1000
    assert histogram.position(950 * per_unit) < scale.tissue < histogram.position(1150 * per_unit)
    bone, skin = preset_scene("ct-bone", Subject(histogram)), preset_scene("ct-skin", Subject(histogram))
    assert opacity_at(bone, histogram.position(1100 * per_unit)) == 0
    assert opacity_at(bone, histogram.position(1500 * per_unit)) > 0.5
    assert opacity_at(skin, histogram.position(200 * per_unit)) == 0
    assert opacity_at(skin, histogram.position(900 * per_unit)) > 0.8


@pytest.mark.parametrize("scan", SCANS)
def test_a_ct_is_suited_by_what_is_made_for_it(scan: str) -> None:
    assert [name for name in PRESETS if fits(name, Subject(SCANS[scan][0]))] == CT_PRESETS


@pytest.mark.parametrize("scan", SCANS)
@pytest.mark.parametrize(
    ("name", "seen", "clear"),
    [
        ("ct-soft-tissue", (60, 400), (AIR, -500)),
        ("ct-lung", (-850, -600, -400), (AIR, TISSUE, BONE)),
        ("ct-angio", (250, 400), (AIR, FAT, TISSUE, 100)),
    ],
)
def test_each_preset_of_a_ct_shows_its_own_hounsfield_units(
    name: str, seen: tuple[int, ...], clear: tuple[int, ...], scan: str
) -> None:
    histogram, position = SCANS[scan]
    scene = preset_scene(name, Subject(histogram))
    assert all(opacity_at(scene, position(units)) > 0 for units in seen)
    assert all(opacity_at(scene, position(units)) == 0 for units in clear)


def test_the_presets_of_mr_show_tissue_or_vessels_and_no_background() -> None:
    """A head: half of it background, tissue about 110 and 170, a hundredth of it vessels."""
    peaks = ((12, 5, 9000), (110, 10, 3000), (170, 10, 1500))
    shares = (sum(w * math.exp(-0.5 * ((n - at) / width) ** 2) for at, width, w in peaks) for n in range(LAST + 1))
    counts = tuple(int(share) + (60 if n > 225 else 0) for n, share in enumerate(shares))
    known = Subject(DensityHistogram((0.0, 510.0), counts), Kind.MR)
    t1, t2, vessels = (preset_scene(name, known) for name in ("mr-t1", "mr-t2", "mr-angio"))
    assert all(opacity_at(scene, 30 / LAST) == 0 for scene in (t1, t2, vessels))
    assert opacity_at(t1, 110 / LAST) > 0.2 and opacity_at(vessels, 110 / LAST) == 0
    assert 0 < opacity_at(t2, 110 / LAST) < 0.1 and min(opacity_at(s, 1.0) for s in (t1, t2, vessels)) > 0.7


SIGNED = DensityHistogram((-1.0, 1.0), tuple(range(1, 129)) + tuple(range(128, 0, -1)))
POSITIVE = DensityHistogram((0.0, 4000.0), SIGNED.counts)


@pytest.mark.parametrize(
    ("name", "known", "why"),
    [
        ("ct-bone", Subject(POSITIVE, Kind.MR), "is made for CT, and the volume says it is: MR"),
        ("molecules", Subject(POSITIVE, Kind.CT), "crystallographic map or electron microscopy map or atom density"),
        ("ct-lung", Subject(SIGNED), "values of -1 to 1 cannot be Hounsfield units"),
        ("difference-map", Subject(POSITIVE), "values on both sides of 0, and the least here is 0"),
        ("labels", Subject(POSITIVE), "labels up to 255 apart, and the values here reach 4000"),
        ("ct-bone", Subject(POSITIVE), None),
        ("ct-bone", Subject(POSITIVE, Kind.CT), None),
        ("mr-t1", Subject(POSITIVE), None),
        ("difference-map", Subject(SIGNED), None),
        ("depth-cue", Subject(POSITIVE, Kind.MR), None),
    ],
)
def test_a_preset_warns_if_the_file_or_its_values_speak_against_it(name: str, known: Subject, why: str | None) -> None:
    line = why_unsuited(name, known)
    assert line is None if why is None else line is not None and why in line and "\n" not in line


def test_data_of_both_signs_is_suited_by_what_tells_them_apart() -> None:
    around_zero = tuple(range(1, 129)) + tuple(range(128, 0, -1))
    signed, unsigned = (DensityHistogram(window, around_zero) for window in ((-1.0, 1.0), (0.0, 1.0)))
    assert [name for name in PRESETS if fits(name, Subject(signed))] == ["orbital", "seismic"]
    assert not any(fits(name, Subject(unsigned)) for name in PRESETS)


@pytest.mark.parametrize(
    ("low", "high", "window"),
    [(0.0, 1.0, (-10.0, 90.0)), (0.05, 0.95, (-5.0, 85.0)), (0.01, 0.99, (-9.0, 89.0))],
)
def test_a_window_leaves_shares_of_the_voxels_out(low: float, high: float, window: tuple[float, float]) -> None:
    survey = Survey(low=-10.0, high=90.0, max_gradient=1.0, voxels=700, no_data=0)
    assert window_of_shares(survey, [7] * 100, low, high) == pytest.approx(window)


def test_a_window_is_never_narrower_than_a_bin() -> None:
    survey = Survey(low=0.0, high=10.0, max_gradient=1.0, voxels=1001, no_data=0)
    assert window_of_shares(survey, [1000, 0, 0, 0, 1], 0.05, 0.95) == (0.0, 2.0)
    constant = Survey(low=3.0, high=3.0, max_gradient=0.0, voxels=9, no_data=0)
    assert window_of_shares(constant, [9, 0], 0.01, 0.99) == (3.0, 3.0)
