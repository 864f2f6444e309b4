"""The scenes that volumes of known kinds are first seen with: as their fields look at them."""

import math
from collections.abc import Callable
from itertools import combinations

import numpy as np
import pytest

from tolerances import ONE_BYTE
from volsplat.client.histogram.density_histogram import LAST
from volsplat.client.histogram.subject import Subject, subject_of
from volsplat.client.scene.class_scenes import CPK
from volsplat.client.scene.contour_scenes import contour_level
from volsplat.client.scene.default_scene import default_scene
from volsplat.client.scene.glow_scenes import phase_colours
from volsplat.client.scene.label_colours import label_colour
from volsplat.client.scene.presets import PRESETS, fits, preset_scene
from volsplat.protocol.description.colours import Colour, colour_from_hex
from volsplat.protocol.description.kind import Band, Kind
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.shading_tables import Field
from volsplat.protocol.description.view_rotation import named_view
from volsplat.protocol.description.volume import Geometry, VolumeDescription
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import rotation_from_quaternion
from volsplat.protocol.geometry.upright import Up
from volsplat.protocol.rules.index_rules import HISTOGRAM_BINS, Survey, density_window

Values = dict[float, int]
AWAY = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0))  # k leads away from the viewer in front
TOWARDS = ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))


def subject(
    values: Values,
    kind: Kind,
    scalar_type: str = "float32",
    window: tuple[float, float] | None = None,
    **changes: object,
) -> Subject:
    low, high = min(values), max(values)
    counts = [0] * HISTOGRAM_BINS
    for value, count in values.items():
        position = (value - low) / (high - low) if high > low else 0.0
        counts[min(int(position * HISTOGRAM_BINS), HISTOGRAM_BINS - 1)] += count
    survey = Survey(low=low, high=high, max_gradient=1.0, voxels=sum(values.values()), no_data=0)
    geometry = changes.pop("geometry", Geometry(dims=(64, 64, 64)))
    description = VolumeDescription(
        name="made",
        format="test",
        geometry=geometry,  # type: ignore[arg-type]
        scalar_type=scalar_type,
        kind=kind,
        **changes,  # type: ignore[arg-type]
    )
    window = density_window(survey, counts, scalar_type) if window is None else window
    return subject_of(description, survey, counts, window, description.up or "auto")


def at(scene: Scene, known: Subject, value: float) -> tuple[float, Colour]:
    """The opacity and the emitted colour of a density."""
    byte = round(known.histogram.position(value) * LAST)
    return scene.tables.opac.entries()[byte], scene.tables.emit.entries()[byte]


def noise(peaks: Values, sigma: float = 1.0) -> Values:
    """Noise about zero, and what rises out of it."""
    values = {n * sigma / 20: int(20000 * math.exp(-0.5 * (n / 20) ** 2)) for n in range(-80, 81)}
    return {**values, **peaks}


MAP = noise({n / 4: 1500 for n in range(16, 40)})


@pytest.mark.parametrize(("kind", "sigmas"), [(Kind.CRYSTAL_MAP, 1.5), (Kind.EM_MAP, 3.0), (Kind.PATTERSON, 3.0)])
def test_a_density_is_a_surface_at_so_many_sigma_above_its_mean_and_nothing_below(kind: Kind, sigmas: float) -> None:
    known = subject(MAP, kind)
    total = sum(MAP.values())
    mean = sum(value * count for value, count in MAP.items()) / total
    sigma = math.sqrt(sum((value - mean) ** 2 * count for value, count in MAP.items()) / total)
    scene = default_scene(known)
    level = mean + sigmas * sigma
    assert contour_level(known).value == pytest.approx(level, rel=1e-3)  # type: ignore[union-attr]
    assert at(scene, known, level - 0.2 * sigma)[0] == at(scene, known, -level)[0] == 0
    assert at(scene, known, level + 0.3 * sigma)[0] > 0.8
    assert scene.tables.opac.entries()[0] == 0 and not scene.shading.two_sided


def test_a_map_cut_close_around_its_particle_is_contoured_where_it_has_something() -> None:
    close = {float(n): 100 for n in range(-20, 21)}  # nothing lies 2 sigma above the mean
    known = subject(close, Kind.EM_MAP)
    assert contour_level(known).told == "1.5 sigma above the mean"  # type: ignore[union-attr]
    assert max(default_scene(known).tables.opac.entries()) > 0.8


def test_a_sigma_is_that_of_the_values_not_of_the_bytes_that_a_window_leaves() -> None:
    far = {**MAP, 1000.0: 40}  # beyond the window, within the 0.05 % that it cuts off
    known = subject(far, Kind.CRYSTAL_MAP)
    assert known.histogram.window[1] < 100 < known.values.high
    assert known.values.deviation > 5


def test_a_difference_map_is_green_above_and_red_below_three_sigma_and_clear_between() -> None:
    known = subject(noise({-6.0: 300, 6.0: 300, -3.5: 100, 3.5: 100}), Kind.DIFFERENCE_MAP)
    scene = default_scene(known)
    three = 3 * known.values.deviation
    (above, green), (below, red) = at(scene, known, 1.3 * three), at(scene, known, -1.3 * three)
    assert above > 0.8 and below > 0.8
    assert max(green) == green[1] > 1.5 * green[0] and max(red) == red[0] > 1.5 * red[1]
    assert at(scene, known, 0.8 * three)[0] == at(scene, known, -0.8 * three)[0] == at(scene, known, 0)[0] == 0


@pytest.mark.parametrize("kind", [kind for kind in Kind if kind not in (Kind.UNKNOWN, Kind.CT, Kind.MR, Kind.SCAN)])
def test_only_differences_statistics_waves_and_seismics_show_what_is_below_zero(kind: Kind) -> None:
    signed = noise({-6.0: 3000, 6.0: 3000})
    known = subject(signed, kind)
    both = kind in (Kind.DIFFERENCE_MAP, Kind.STATISTIC_MAP, Kind.WAVE_FUNCTION, Kind.SEISMIC)
    assert (at(default_scene(known), known, -6.0)[0] > 0) == both


def test_an_orbital_is_contoured_where_most_of_its_probability_is_enclosed() -> None:
    wave = {0.0: 10000, **{sign * n / 100: 1000 // n for n in range(1, 40) for sign in (-1, 1)}}
    known = subject(wave, Kind.WAVE_FUNCTION)
    level = contour_level(known).value  # type: ignore[union-attr]
    total = sum(count * value * value for value, count in wave.items())
    inside = sum(count * value * value for value, count in wave.items() if abs(value) >= level - 1e-4)
    assert 0.75 < inside / total < 0.85


# Classes

ELEMENTS = tuple(
    Band(name, max(32 * n, 1), 32 * n + 31) for n, name in enumerate(("bond", "H", "C", "N", "O", "P", "S", "other"))
)
ATOMS = {0.0: 100000, **{float(n): 10 for n in range(1, 256)}}


@pytest.mark.parametrize("build", [default_scene, lambda known: preset_scene("atoms", known)])
def test_elements_have_the_colours_of_their_own_bands(build: Callable[[Subject], Scene]) -> None:
    known = subject(ATOMS, Kind.ELEMENTS, "uint8", bands=ELEMENTS)
    scene = build(known)
    colours = scene.tables.refl.entries()
    for band in ELEMENTS:
        expected = colour_from_hex(CPK[band.name])
        for byte in (band.low, band.high):
            shown = colours[int(byte)]
            assert [channel / max(shown) for channel in shown] == pytest.approx(
                [channel / max(expected) for channel in expected]
            )
    carbon, nitrogen, oxygen, sulphur = (colours[byte] for byte in (80, 112, 144, 208))
    assert max(carbon) - min(carbon) < 0.02
    assert max(nitrogen) == nitrogen[2] > 1.5 * nitrogen[1] and max(oxygen) == oxygen[0] > 2 * oxygen[1]
    assert min(sulphur[:2]) > 2 * sulphur[2]
    opacity = scene.tables.opac.entries()
    assert opacity[0] == 0 and all(opacity[int(band.high)] > 0.8 for band in ELEMENTS)


def test_labels_are_solid_in_distinct_colours_about_a_clear_background() -> None:
    known = subject({0.0: 900, 1.0: 50, 2.0: 30, 300.0: 200}, Kind.LABELS, "int16")
    scene = default_scene(known)
    shown = {label: at(scene, known, label) for label in (1.0, 2.0, 300.0)}
    assert at(scene, known, 0.0)[0] == 0
    assert all(opacity > 0.8 for opacity, _ in shown.values())


def test_labels_without_colours_have_each_its_own_whatever_else_the_file_holds() -> None:
    colours = [label_colour(number) for number in range(1, 193)]
    assert len(set(colours)) == 192 and label_colour(193) == colours[0]
    assert min(math.dist(one, other) for one, other in combinations(colours[:24], 2)) > 0.1
    few, many = ({0.0: 900, 5.0: 30} | {float(n): 20 for n in range(200, last)} for last in (201, 240))
    shown = [
        at(default_scene(known), known, 5.0)[1] for known in (subject(v, Kind.LABELS, "uint8") for v in (few, many))
    ]
    assert shown[0] == pytest.approx(shown[1])


def test_segments_have_the_colours_that_their_file_states() -> None:
    bands = (Band("liver", 1, 1, (0.9, 0.1, 0.2)), Band("vessels", 7, 7, (0.1, 0.2, 0.9)))
    known = subject({0.0: 900, 1.0: 50, 7.0: 30, 9.0: 5}, Kind.LABELS, "uint8", bands=bands)
    scene = default_scene(known)
    for band in bands:
        opacity, colour = at(scene, known, band.low)
        assert opacity > 0.8 and band.colour is not None
        assert [channel / max(colour) for channel in colour] == pytest.approx(
            [channel / max(band.colour) for channel in band.colour]
        )
    assert at(scene, known, 9.0)[0] == at(scene, known, 3.0)[0] == at(scene, known, 0.0)[0] == 0


def test_classes_that_lie_too_near_for_bytes_still_make_a_scene() -> None:
    bands = tuple(Band(str(n), n, n) for n in range(1, 1000))
    known = subject({float(n): 1 for n in range(1000)}, Kind.LABELS, "int16", bands=bands)
    assert max(default_scene(known).tables.opac.entries()) > 0.8


# Scans

PEAKS = ((-1000, 12, 6000), (-100, 12, 150), (40, 12, 2500), (900, 200, 120))
HEAD = {
    float(v): int(1 + sum(n * math.exp(-0.5 * ((v - where) / wide) ** 2) for where, wide, n in PEAKS))
    for v in range(-1024, 1500)
}


def uses_ct_tables(known: Subject) -> bool:
    return default_scene(known).shading.modulation  # which no scene by the histogram alone has


@pytest.mark.parametrize(("kind", "ct"), [(Kind.UNKNOWN, True), (Kind.CT, True), (Kind.MR, False), (Kind.SCAN, False)])
def test_only_a_ct_gets_the_tables_of_one_whatever_its_histogram_looks_like(kind: Kind, ct: bool) -> None:
    assert uses_ct_tables(subject(HEAD, kind, "int16")) == ct


def test_hounsfield_units_are_believed_where_they_are_stated() -> None:
    odd = {-1000.0: 500, -300.0: 300, 60.0: 100, 700.0: 400, 1400.0: 10}  # as no head has them
    known = subject(odd, Kind.CT, "int16", value_unit="HU")
    assert known.ct is not None
    for hounsfield in (-1000, 0, 700):
        assert known.ct.position(hounsfield) * LAST == pytest.approx(
            known.histogram.position(hounsfield) * LAST, abs=ONE_BYTE
        )
    assert subject(odd, Kind.CT, "int16").ct is None


# Single slices


@pytest.mark.parametrize(
    ("dims", "view"),
    [
        ((64, 48, 1), "bottom"),
        ((64, 1, 48), "front"),
        ((1, 64, 48), "left"),
        ((64, 48, 9), "bottom"),
        ((9, 64, 48), "left"),
        ((64, 48, 20), "bottom"),
        ((64, 48, 24), "front"),
        ((64, 1, 1), "front"),
    ],
)
def test_a_slice_and_a_slab_are_seen_from_their_face(dims: tuple[int, int, int], view: str) -> None:
    known = subject(HEAD, Kind.UNKNOWN, geometry=Geometry(dims=dims))
    assert default_scene(known).view.rotation == preset_scene("ct-skin", known).view.rotation == named_view(view)


def test_a_single_slice_is_a_picture_in_greys_and_of_a_ct_in_those_of_soft_tissue() -> None:
    flat = Geometry(dims=(64, 48, 1))
    scene = default_scene(subject({float(n): 10 for n in range(-50, 900)}, Kind.MR, "int16", geometry=flat))
    emitted = scene.tables.emit.entries()
    assert set(scene.tables.opac.entries()) == {1.0} and not scene.shading.diffuse
    assert all(red == green == blue for red, green, blue in emitted) and emitted[0][0] == 0 and emitted[LAST][0] == 1
    known = subject(HEAD, Kind.CT, "int16", geometry=flat, value_unit="HU")
    greys = [at(default_scene(known), known, hounsfield)[1][0] for hounsfield in (-1000, 40, 1000)]
    assert greys[0] == 0 < greys[1] < 1 == greys[2]


def test_a_body_that_fills_the_grid_is_a_ct_where_its_units_are_stated() -> None:
    full = {value: count for value, count in HEAD.items() if value > -200}
    assert uses_ct_tables(subject(full, Kind.CT, "int16", value_unit="HU"))


def test_the_face_of_a_slice_is_where_its_volume_stands_upright() -> None:
    flat = VolumeDescription(name="flat", format="test", geometry=Geometry(dims=(64, 48, 1)), scalar_type="uint8")
    survey = Survey(low=0.0, high=1.0, max_gradient=1.0, voxels=2, no_data=0)
    assert subject_of(flat, survey, [1, 1], (0.0, 255.0), "+z").first_view == "bottom"
    assert subject_of(flat, survey, [1, 1], (0.0, 255.0), "+y").first_view == "front"


UPRIGHT_Z = (0.0, 0.0, 1.0)


@pytest.mark.parametrize(
    ("kind", "dims", "up"),
    [
        (Kind.SEISMIC, (64, 48, 40), "+z"),
        (Kind.SEISMIC, (64, 48, 9), "-z"),
        (Kind.UNKNOWN, (64, 48, 20), "+z"),
        (Kind.EM_MAP, (20, 64, 48), "+z"),
    ],
)
def test_a_survey_and_what_lies_flat_show_three_sides_and_the_upper_one(
    kind: Kind, dims: tuple[int, int, int], up: Up
) -> None:
    known = subject(MAP, kind, geometry=Geometry(dims=dims), up=up)
    rotation = rotation_from_quaternion(default_scene(known).view.rotation)
    towards_viewer = [matrices.column(rotation, axis)[2] for axis in range(3)]
    assert all(abs(cosine) > 0.3 for cosine in towards_viewer)
    assert towards_viewer[2] > 0 and matrices.applied(rotation, UPRIGHT_Z)[1] > 0.8


@pytest.mark.parametrize(
    ("kind", "dims"),
    [
        (Kind.CT, (64, 48, 20)),
        (Kind.SPECTRAL_CUBE, (64, 20, 48)),
        (Kind.EM_MAP, (64, 48, 40)),
        (Kind.EM_MAP, (64, 20, 48)),
        (Kind.SEISMIC, (64, 1, 48)),
    ],
)
def test_patients_the_sky_and_what_is_broad_in_front_are_seen_from_there(
    kind: Kind, dims: tuple[int, int, int]
) -> None:
    known = subject(MAP, kind, geometry=Geometry(dims=dims), up="+z", anatomical=kind is Kind.CT)
    assert default_scene(known).view.rotation == named_view("front")


# What glows


@pytest.mark.parametrize(("matrix", "recedes"), [(AWAY, True), (TOWARDS, False)])
def test_a_spectral_cube_glows_in_the_colours_of_its_spectrum_and_its_noise_is_clear(
    matrix: tuple[tuple[float, ...], ...], recedes: bool
) -> None:
    geometry = Geometry(dims=(64, 64, 64), index_to_physical=matrix)  # type: ignore[arg-type]
    known = subject(noise({20.0: 2000, 40.0: 500}), Kind.SPECTRAL_CUBE, geometry=geometry)
    scene = default_scene(known)
    assert scene.cross_bar.emit is Field.GRID_K
    blue, red = scene.tables.emit.entries()[0 if recedes else LAST], scene.tables.emit.entries()[LAST if recedes else 0]
    assert max(blue) == blue[2] and max(red) == red[0]
    assert at(scene, known, 2.0)[0] == at(scene, known, -3.0)[0] == 0 < at(scene, known, 20.0)[0] < 0.6
    assert not scene.shading.diffuse
    assert scene.view.rotation == named_view("front")  # the sky as it is seen


AMPLITUDES = {float(n): int(2000 * math.exp(-n / 20)) + 1 for n in range(200)}


@pytest.mark.parametrize("build", [default_scene, lambda known: preset_scene("structure-factors", known)])
def test_reflections_are_coloured_by_their_phase(build: Callable[[Subject], Scene]) -> None:
    known = subject(AMPLITUDES, Kind.STRUCTURE_FACTORS, second_scalar=(0.0, 360.0), strength_name="phase")
    scene = build(known)
    assert scene.cross_bar.emit is Field.STRENGTH and scene.tables.emit == phase_colours()
    opacity = scene.tables.opac.entries()
    shares = [known.histogram.share_above(byte) for byte in (n for n, value in enumerate(opacity) if value >= 0.5)]
    assert opacity[LAST] == 1 and shares[0] * sum(AMPLITUDES.values()) > 1000  # enough of them to be seen
    assert all(later >= earlier for earlier, later in zip(opacity, opacity[1:], strict=False))


@pytest.mark.parametrize("build", [default_scene, lambda known: preset_scene("structure-factors", known)])
def test_phases_in_bands_are_coloured_by_band(build: Callable[[Subject], Scene]) -> None:
    bands = tuple(Band(f"{45 * n} to {45 * n + 45} degrees", 32 * n, 32 * n + 31) for n in range(8))
    known = subject({float(n): 10 for n in range(256)}, Kind.STRUCTURE_FACTORS, "uint8", bands=bands)
    scene = build(known)
    emitted, opacity = scene.tables.emit.entries(), scene.tables.opac.entries()
    assert scene.cross_bar.emit is Field.DENSITY
    assert len({emitted[32 * n + 20] for n in range(8)}) == 8
    for n in range(8):
        assert opacity[32 * n] == 0 and opacity[32 * n + 31] == 1


def test_amplitudes_without_phases_have_no_colours_of_phase() -> None:
    for scene in (
        default_scene(subject(AMPLITUDES, Kind.STRUCTURE_FACTORS)),
        preset_scene("structure-factors", subject(AMPLITUDES, Kind.UNKNOWN)),
    ):
        assert scene.cross_bar.emit is Field.DENSITY
        assert all(max(colour) == colour[2] for colour in scene.tables.emit.entries())  # of one hue


def test_the_galaxy_preset_takes_k_for_the_spectrum_of_what_states_none() -> None:
    assert preset_scene("galaxy", subject(MAP, Kind.UNKNOWN)).cross_bar.emit is Field.GRID_K
    assert preset_scene("galaxy").cross_bar.emit is Field.GRID_K


def test_seismics_of_one_sign_are_shown_by_their_histogram() -> None:
    known = subject({float(n): 100 for n in range(1500, 4000)}, Kind.SEISMIC)
    assert max(default_scene(known).tables.opac.entries()) > 0.5


# All of them


@pytest.mark.parametrize("kind", Kind)
@pytest.mark.parametrize("values", [{7.0: 1000}, {0.0: 1000, 1.0: 1}, {-1.0: 500, 1.0: 500}, {-3.0: 10, -1.0: 10}])
def test_any_kind_of_anything_makes_a_scene_that_shows_something(kind: Kind, values: Values) -> None:
    known = subject(values, kind)
    opacity = default_scene(known).tables.opac.entries()
    if len(values) > 1 and kind is not Kind.STRUCTURE_FACTORS:
        assert any(opacity[byte] > 0 for byte, count in enumerate(known.histogram.counts) if count)
    for name in PRESETS:
        preset_scene(name, known)


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        (Kind.CT, ["ct-skin", "ct-bone", "surfaces", "ct-soft-tissue", "ct-lung", "ct-angio"]),
        (Kind.MR, ["mr-t1", "mr-t2", "mr-angio"]),
        (Kind.LABELS, ["labels"]),
        (Kind.DIFFERENCE_MAP, ["difference-map"]),
        (Kind.CRYSTAL_MAP, ["xray-map", "molecules"]),
        (Kind.ELEMENTS, ["atoms"]),
        (Kind.EM_MAP, ["em-map", "molecules"]),
        (Kind.WAVE_FUNCTION, ["orbital"]),
        (Kind.STRUCTURE_FACTORS, ["structure-factors"]),
        (Kind.SPECTRAL_CUBE, ["galaxy"]),
        (Kind.SEISMIC, ["seismic"]),
    ],
)
def test_the_presets_that_suit_a_kind_are_known(kind: Kind, names: list[str]) -> None:
    assert [name for name in PRESETS if fits(name, subject(MAP, kind))] == names


# Windows


@pytest.mark.parametrize("name", ["ct-skin", "ct-bone", "surfaces", "ct-soft-tissue", "ct-lung", "ct-angio", None])
@pytest.mark.parametrize("window", [(-600, 1500), (0, 400), (0, 2000), (300, 1500), (500, 1900), (1500, 3000)])
def test_a_window_that_begins_within_what_is_seen_of_a_ct_leaves_the_air_clear(
    window: tuple[float, float], name: str | None
) -> None:
    """And what lies in the window as opaque as it is in a wider one."""
    scenes = []
    for of in (window, (-1024.0, 3071.0)):
        known = subject({float(n): 100 for n in range(-1024, 3072)}, Kind.CT, "int16", of, value_unit="HU")
        scenes.append((preset_scene(name, known) if name else default_scene(known), known))
    (narrow, under), (wide, whole) = scenes
    assert narrow.tables.opac.entries()[0] == 0
    entry = (window[1] - window[0]) / LAST
    for hounsfield in np.arange(window[0] + 2 * entry, min(window[1], 1000) if window[1] > 1000 else 0, entry):
        seen, expected = at(narrow, under, hounsfield)[0], at(wide, whole, hounsfield)[0]
        assert seen == pytest.approx(expected, abs=0.1)  # a wide window's entries are 16 units apart


@pytest.mark.parametrize("window", [(1.0, 7.0), (4.0, 8.0), (0.5, 3.0)])
def test_a_window_that_begins_within_labels_leaves_the_background_clear(window: tuple[float, float]) -> None:
    known = subject({0.0: 5000, **{float(n): 100 for n in range(1, 10)}}, Kind.LABELS, "uint8", window)
    scene = default_scene(known)
    assert at(scene, known, 0)[0] == 0
    assert all(at(scene, known, n)[0] > 0.8 for n in range(1, 10) if window[0] < n)


def test_a_class_that_begins_with_the_lowest_values_is_seen_under_any_window() -> None:
    known = subject({float(n): 100 for n in range(1, 10)}, Kind.LABELS, "uint8", (3.0, 9.0))
    assert all(at(default_scene(known), known, n)[0] > 0.8 for n in range(1, 10))


def test_glowing_gas_is_clear_below_a_window_that_begins_within_it() -> None:
    cube = noise({n / 4: 400 for n in range(16, 200)})
    for low in (4.0, 20.0, 49.0):
        known = subject(cube, Kind.SPECTRAL_CUBE, window=(low, 60.0))
        opacity = default_scene(known).tables.opac.entries()
        assert opacity[0] == 0 and opacity[1] > 0


@pytest.mark.parametrize("kind", [Kind.DIFFERENCE_MAP, Kind.STATISTIC_MAP, Kind.WAVE_FUNCTION])
@pytest.mark.parametrize("values", [noise({-6.0: 300, 6.0: 300}), {**noise({}, 0.1), -6.0: 3000, -7.0: 300}])
@pytest.mark.parametrize("window", [(5.0, 8.0), (-8.0, -5.0), (4.5, 20.0), (-0.1, 0.1), (-1.0, 7.0)])
def test_a_window_on_one_side_of_both_signs_shows_that_side_and_what_is_between_not(
    window: tuple[float, float], values: Values, kind: Kind
) -> None:
    known = subject(values, kind, window=window)
    scene = default_scene(known)
    outside = 0.0 < window[0] or window[1] < 0.0
    assert not outside or at(scene, known, 0.0)[0] == 0
