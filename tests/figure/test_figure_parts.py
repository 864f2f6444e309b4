"""What a figure shows beside its picture: lengths as they are, ticks at round numbers, sides, the tables' colours."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.scenes.arbitrary import geometries, plain_scene, quaternions, zooms
from tolerances import ROUNDING
from volsplat.client.figure.axis_ticks import tick_texts, ticks
from volsplat.client.figure.colour_bars import MOST_CLASSES, colour_bars
from volsplat.client.figure.drawing import Anchor, Area, Line, Ramp, Words
from volsplat.client.figure.figure import Figure, figure_with
from volsplat.client.figure.frame_figure import FrameFigure
from volsplat.client.figure.layout import figure_extent, laid_out, sized
from volsplat.client.figure.pointing_labels import place_of, why_never_labelled, why_unlabelled
from volsplat.client.figure.room import Room
from volsplat.client.figure.scale_bars import bar_length, is_seen
from volsplat.client.figure.side_marks import edge_marks
from volsplat.client.figure.type_faces import width_of
from volsplat.client.movie.key_frames import turntable
from volsplat.client.scene.colour_maps import colormap, lit_and_glowing
from volsplat.client.volume.scales import scales_of
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.block_extremes import BlockExtremes
from volsplat.protocol.description.kind import Band, Kind
from volsplat.protocol.description.scene import Image, Quantise, Scene, View
from volsplat.protocol.description.shading_tables import ColourTable, CrossBar, Field, ScalarTable, Tables
from volsplat.protocol.description.view_rotation import named_view, rotation_from_angles
from volsplat.protocol.description.volume import Geometry, GridAxis, VolumeDescription
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.rules.index_rules import HISTOGRAM_BINS, Survey
from volsplat.protocol.rules.resolved_view import screen_rotation
from volsplat.protocol.text.errors import BadInput

OPPOSITE = {"left": "right", "top": "bottom"}
GEOMETRY = Geometry(dims=(8, 9, 100))
HEAD = VolumeDescription(
    name="head", format="NRRD", geometry=GEOMETRY, scalar_type="int16", unit="mm", value_unit="HU", anatomical=True
)
SCENE = plain_scene()
PICTURE = np.zeros((1, 1, 4), np.float32)  # its pixels decide nothing of what is about it
replace = msgspec.structs.replace


def surveyed(description: VolumeDescription = HEAD) -> SurveyedVolume:
    return SurveyedVolume(
        description=description,
        survey=Survey(low=-1000.0, high=3000.0, max_gradient=500.0, voxels=10, no_data=0),
        density_counts=[10],
        strength_counts=[10],
        extremes=BlockExtremes.nothing(description.geometry.dims),
    )


def replace_counts(volume: SurveyedVolume, values: Iterable[int]) -> SurveyedVolume:
    """With voxels of just these values, from 0 to 255."""
    counts = [1000 if n in set(values) else 0 for n in range(256)]
    survey = Survey(low=-0.5, high=255.5, max_gradient=500.0, voxels=sum(counts), no_data=0)
    return dataclasses.replace(volume, survey=survey, density_counts=counts)


@given(geometry=geometries(), rotation=quaternions, zoom=zooms, width=st.integers(16, 4000))
def test_a_scale_bar_is_as_long_as_its_length_lies_on_the_screen(
    geometry: Geometry, rotation: tuple[float, float, float, float], zoom: float, width: int
) -> None:
    described = replace(HEAD, geometry=geometry, anatomical=False, up="+z")
    scene = plain_scene(view=View(rotation=rotation, zoom=zoom, up="+z"), size=(width, 64))
    (scale,) = scales_of(described)
    length, pixels = bar_length(scale, scene, described)
    to_physical = matrices.transposed(screen_rotation(scene.view))
    across = matrices.applied(to_physical, (length * scale.length, 0.0, 0.0))
    steps = matrices.applied(matrices.inverse(geometry.index_to_physical), across)
    start, end = place_of((0.0, 0.0, 0.0), scene, geometry), place_of(steps, scene, geometry)
    assert (end[0] - start[0], end[1] - start[1]) == pytest.approx((pixels, 0.0), rel=ROUNDING, abs=1e-6 * pixels)
    assert 0 < pixels < width


@given(geometry=geometries(), rotation=quaternions, zoom=zooms)
def test_a_bar_for_one_axis_is_as_long_as_that_lies_on_the_screen_and_there_is_none_along_the_line_of_sight(
    geometry: Geometry, rotation: tuple[float, float, float, float], zoom: float
) -> None:
    axes = tuple(GridAxis(name, unit, 0.0, 2.0) for name, unit in (("x", "deg"), ("y", "deg"), ("v", "km/s")))
    described = replace(HEAD, geometry=geometry, axes=axes, anatomical=False, up="+z", unit="deg")
    scene = plain_scene(view=View(rotation=rotation, zoom=zoom, up="+z"), size=(500, 400))
    seen = [scale for scale in scales_of(described) if is_seen(scale, scene, geometry)]
    start, end = place_of((0.0, 0.0, 0.0), scene, geometry), place_of((0.0, 0.0, 1.0), scene, geometry)
    along = matrices.applied(screen_rotation(scene.view), matrices.column(geometry.index_to_physical, 2))
    degrees = math.degrees(math.atan2(math.hypot(along[0], along[1]), abs(along[2])))
    assert ("v" in [scale.name for scale in seen]) == (degrees >= 20) or degrees == pytest.approx(20)
    for scale in seen:
        if scale.name == "v":
            length, pixels = bar_length(scale, scene, described)
            step = math.dist(start, end)
            assert pixels == pytest.approx(length / 2.0 * step, rel=1e-4)


@given(start=st.floats(-1e6, 1e6), span=st.floats(1e-3, 1e7), most=st.integers(2, 12))
def test_ticks_are_the_multiples_of_a_round_step_within_the_range(start: float, span: float, most: int) -> None:
    low, high = start * span, start * span + span
    values = ticks(low, high, most)
    assert len(values) <= most and all(low <= value <= high for value in values)
    assert len(values) >= most / 2.5 - 1  # a closer step would have more than `most`
    steps = [after - before for before, after in zip(values, values[1:], strict=False)]
    if steps:
        assert f"{steps[0]:.0e}"[0] in "125"
        assert steps == pytest.approx([steps[0]] * len(steps), rel=1e-6)
        texts = tick_texts(values)
        assert len(set(texts)) == len(texts)
        assert [float(text.replace("−", "-")) for text in texts] == pytest.approx(values, rel=1e-9, abs=steps[0] / 100)


@pytest.mark.parametrize(("high", "most"), [(0.3, 7), (0.6, 7), (1.2, 7), (0.7, 8), (0.3, 4)])
def test_an_axis_that_ends_at_a_round_number_has_a_tick_there(high: float, most: int) -> None:
    assert ticks(0.0, high, most)[-1] == high
    assert ticks(-high, 0.0, most)[0] == -high


@given(st.lists(st.sampled_from([0.0, 0.25, 0.5, 1.0]), min_size=2, max_size=40))
def test_a_ramp_and_a_curve_are_told_by_the_points_at_which_they_bend(values: list[float]) -> None:
    ramp = Ramp(0.0, 0.0, 1.0, 1.0, tuple((value, 1 - value, 0.5) for value in values))
    places = np.linspace(0, 1, len(values))
    stops = ramp.stops()
    drawn = np.interp(places, [position for position, _ in stops], [colour[0] for _, colour in stops])
    assert drawn == pytest.approx(values, abs=ROUNDING)
    points = Area(0.0, 0.0, 1.0, 1.0, tuple(values), (0.0, 0.0, 0.0), 1.0).outline()
    heights = 1 - np.interp(places, [x for x, _ in points], [y for _, y in points])
    assert heights == pytest.approx(values, abs=ROUNDING)
    assert len(Ramp(0.0, 0.0, 1.0, 1.0, ((0.5, 0.5, 0.5),) * len(values)).stops()) == 2


@pytest.mark.parametrize(
    ("view", "marks"),
    [("front", "R L S I"), ("back", "L R S I"), ("bottom", "R L A P"), ("top", "L R A P"), ("left", "A P S I")],
)
def test_a_patients_sides_lie_where_a_radiologist_looks_for_them(view: str, marks: str) -> None:
    told = edge_marks(View(rotation=named_view(view), up="+z"), HEAD)
    assert " ".join(told[edge] for edge in ("left", "right", "top", "bottom")) == marks


def test_an_oblique_edge_is_called_by_the_nearer_side_first() -> None:
    told = edge_marks(View(rotation=rotation_from_angles(30, 0), up="+z"), HEAD)
    assert {told["left"], told["right"]} in ({"RA", "LP"}, {"RP", "LA"})


@given(rotation=quaternions)
def test_what_lies_on_one_edge_has_its_opposite_on_the_other(rotation: tuple[float, float, float, float]) -> None:
    told = edge_marks(View(rotation=rotation, up="+z"), HEAD)
    other = str.maketrans("LRAPSI", "RLPAIS")
    for edge, beyond in OPPOSITE.items():
        assert told[edge] and sorted(told[edge]) == sorted(told[beyond].translate(other))


def with_tables(emit: float, refl: float, **more: object) -> Scene:
    def table(factor: float) -> ColourTable:
        return ColourTable(points=((0.0, (0.0, 0.1 * factor, 0.0)), (1.0, (factor, factor, 0.5 * factor))))

    tables = Tables(emit=table(emit), refl=table(refl), opac=ScalarTable(points=((0.0, 0.0), (1.0, 0.4))))
    return replace(SCENE, tables=tables, **more)


def test_colours_that_differ_by_a_factor_share_a_strip_and_others_have_one_each() -> None:
    (bar,) = colour_bars(with_tables(0.3, 0.6), surveyed()).bars
    assert [strip.name for strip in bar.strips] == [""]
    assert bar.strips[0].colours[-1] == pytest.approx((0.9, 0.9, 0.45))
    assert (bar.axis.low, bar.axis.high) == surveyed().automatic_window
    assert bar.headings(400, 11) == ["CT number (HU); curve: opacity, 0 to 0.4"]
    assert bar.headings(200, 11) == ["CT number (HU)", "curve: opacity, 0 to 0.4"]
    assert bar.height(200, 11) > bar.height(400, 11)
    black = replace(SCENE.tables, emit=ColourTable(points=((0.0, (0.0, 0.0, 1.0)),)))
    (bar,) = colour_bars(replace(SCENE, tables=black), surveyed()).bars
    assert [strip.name for strip in bar.strips] == ["emitted", "reflected"]


@pytest.mark.parametrize("name", ["viridis", "gray", "coolwarm"])
def test_the_bar_of_a_colour_map_has_its_own_colours(name: str) -> None:
    of = colormap(name)
    both = lit_and_glowing(of)
    tables = replace(SCENE.tables, emit=both.emit, refl=both.refl)
    (bar,) = colour_bars(replace(SCENE, tables=tables), surveyed()).bars
    (strip,) = bar.strips
    assert np.array(strip.colours) == pytest.approx(np.array(list(of.entries())), abs=ROUNDING)


def test_a_table_along_an_axis_of_the_file_is_told_in_what_that_stands_for() -> None:
    axes = tuple(GridAxis(name, "km/s", 200.0, -4.0) for name in ("x", "y", "velocity"))
    cube = replace(HEAD, axes=axes, anatomical=False)
    by_velocity = CrossBar(emit=Field.GRID_K, refl=Field.GRID_K)
    velocity, density = colour_bars(with_tables(1.0, 0.0, cross_bar=by_velocity), surveyed(cube)).bars
    assert velocity.headings(400, 11) == ["velocity (km/s)"] and velocity.axis.high == 200.0
    assert velocity.axis.low == pytest.approx(200 - 4 * 100 * 255 / 256)
    assert velocity.strips[0].colours[-1] == (0.0, 0.1, 0.0)  # of index 0
    assert density.opacities is not None and not density.strips


def test_classes_have_a_legend_of_those_that_can_be_seen() -> None:
    bands = (Band("air", 0.0, 0.0), Band("bone", 1.0, 1.0), Band("hidden", 2.0, 2.0))
    labels = replace(HEAD, kind=Kind.LABELS, bands=bands)
    colours = ColourTable(points=tuple((n / 255, (1.0, 0.0, 0.0) if n == 1 else (0.0, 0.0, 1.0)) for n in range(3)))
    opac = ScalarTable(points=((0.0, 0.0), (1 / 255, 0.5), (2 / 255, 0.0)))
    scene = replace(SCENE, tables=Tables(emit=colours, refl=colours, opac=opac), quantise=Quantise(window=(0.0, 255.0)))
    there = replace_counts(surveyed(labels), range(3))
    found = colour_bars(scene, there)
    assert not found.bars and found.legend == (("bone", (1.0, 0.0, 0.0)),)
    assert 0 < found.height(100, 10) < found.height(100, 20)
    assert colour_bars(scene, replace_counts(surveyed(labels), [0, 2])).legend == ()
    assert colour_bars(scene, replace_counts(surveyed(labels), [0, 2]), of_several=True).legend == found.legend


def test_labels_without_names_have_a_legend_of_numbers_or_a_bar_if_they_are_too_many() -> None:
    few = surveyed_labels([0, 1, 4, 9])
    found = colour_bars(few.default_scene(), few)
    assert not found.bars and [name for name, _ in found.legend] == ["1", "4", "9"]
    assert len({colour for _, colour in found.legend}) == 3
    many = surveyed_labels(range(MOST_CLASSES + 2))
    found = colour_bars(many.default_scene(), many)
    assert not found.legend and [bar.axis.label for bar in found.bars] == ["label"]


@pytest.mark.parametrize(("values", "names"), [([0, 0, 1, 4, 9], "1 4 9"), ([0, 1, 1], "0"), ([0, 0, 1], "1")])
def test_whole_numbers_that_are_shown_as_labels_have_a_legend_whatever_the_file_states(
    values: list[int], names: str
) -> None:
    """Of those that are seen: which is the most frequent is the background."""
    unstated = surveyed_labels(values, Kind.UNKNOWN)
    found = colour_bars(unstated.default_scene(), unstated)
    assert not found.bars and " ".join(name for name, _ in found.legend) == names


def test_what_is_not_taken_for_labels_has_a_legend_under_the_preset_that_colours_it_so() -> None:
    plain = surveyed_labels([0, 10, 50], Kind.UNKNOWN)
    assert not colour_bars(plain.default_scene(), plain).legend
    labels = plain.begun_scene("labels")
    assert [name for name, _ in colour_bars(labels, plain).legend] == ["10", "50"]
    assert not colour_bars(plain.begun_scene("depth-cue"), plain).legend


@given(low=st.integers(0, 200), span=st.integers(1, 55), scale=st.floats(1e-6, 1e6))
def test_a_bar_of_densities_reaches_as_far_as_the_data_does(low: int, span: int, scale: float) -> None:
    survey = Survey(low=low * scale, high=(low + span) * scale, max_gradient=1.0, voxels=10, no_data=0)
    scene = with_tables(1.0, 0.0, quantise=Quantise(window=(0.0, 255.0 * scale)))
    (bar,) = colour_bars(scene, dataclasses.replace(surveyed(), survey=survey)).bars
    assert (bar.axis.low, bar.axis.high) == pytest.approx((survey.low, survey.high))
    cut = slice(low, low + span + 1)
    assert bar.opacities == tuple(scene.tables.opac.entries()[cut])
    assert bar.strips[0].colours == tuple(scene.tables.emit.entries()[cut])


def surveyed_labels(values: Sequence[int], kind: Kind = Kind.LABELS) -> SurveyedVolume:
    """Of a file that names none of them; as many voxels of each as it comes in `values`."""
    labels = VolumeDescription(name="atlas", format="NIfTI-1", geometry=GEOMETRY, scalar_type="uint8", kind=kind)
    most = max(values)
    counts = [0] * HISTOGRAM_BINS
    for value in values:
        counts[min(value * HISTOGRAM_BINS // most, HISTOGRAM_BINS - 1)] += 1000
    survey = Survey(low=0.0, high=float(most), max_gradient=9.0, voxels=sum(counts), no_data=0)
    return dataclasses.replace(surveyed(labels), survey=survey, density_counts=counts)


@given(width=st.floats(2, 20), height=st.floats(5, 20), dpi=st.floats(100, 400), titled=st.booleans())
def test_a_figure_has_its_size_in_print_whatever_is_in_it(
    width: float, height: float, dpi: float, titled: bool
) -> None:
    figure = Figure(width=width, height=height, dpi=dpi, title="a head" if titled else "")
    scene = sized(figure, SCENE, surveyed())
    assert figure_extent(figure, scene, surveyed()) == (
        math.floor(width / 2.54 * dpi + 0.5),
        math.floor(height / 2.54 * dpi + 0.5),
    )


@given(width=st.integers(16, 8000), height=st.integers(16, 8000), dpi=st.floats(30, 600), points=st.floats(4, 40))
def test_words_suit_the_pixels_of_a_picture_that_nobody_says_how_to_print(
    width: int, height: int, dpi: float, points: float
) -> None:
    image = Image(width=width, height=height)
    em = Figure().em_on(image)
    assert em in (10, 60) or em == pytest.approx(min(width, height) / 36, abs=0.5)
    assert 10 <= em <= 60
    assert Figure(dpi=dpi).em_on(image) == max(round(7 * dpi / 72), 1) == Figure(width=8.0, dpi=dpi).em_on(image)
    assert Figure(text_size=points).em_on(image) == round(points * 300 / 72)


def test_without_room_for_a_picture_there_is_no_figure() -> None:
    for figure, why in (
        (Figure(width=1.0, height=1.0), "has no room for its picture"),
        (Figure(width=200.0), "more than 16384 on a side"),
        (Figure(height=4.0), "needs its width"),
    ):
        with pytest.raises(BadInput, match=why):
            sized(figure, SCENE, surveyed())


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"width": "8em"}, "figure: width='8em': .*; allowed: 1/2 to 200 cm, or \"auto\""),
        ({"height": 0.1}, 'figure: height must be 1/2 to 200 cm or "auto", not 0.1'),
        ({"dpi": None}, "figure: dpi=None: .*; allowed: 20 to 2400 pixels per inch"),
        ({"title": 3}, "figure: title=3: .*; allowed: a text"),
        ({"labels": 3}, "figure: labels=3: .*; allowed: "),
        ({"labels": {"nose": (1, 2)}}, "figure: labels="),
        ({"ink": "reed"}, "figure: ink='reed': .*; allowed: "),
        ({"scale_bar": "yes"}, "figure: scale_bar='yes': .*; allowed: true or false"),
    ],
)
def test_what_no_figure_can_have_is_refused_where_it_is_made(options: dict[str, Any], told: str) -> None:
    with pytest.raises(BadInput, match=told) as refused:
        Figure(**options)
    assert "\n" not in str(refused.value)
    with pytest.raises(BadInput, match=told):
        figure_with(Figure(), options)


def test_a_figure_takes_other_libraries_numbers_and_labels_by_their_words() -> None:
    figure = Figure(width=np.float32(8), dpi=np.int64(50), labels={"nose": (1, 2, 3)}, ink="red")  # type: ignore[arg-type]
    assert figure == Figure(width=8.0, dpi=50.0, labels=(("nose", (1.0, 2.0, 3.0)),), ink=(1.0, 0.0, 0.0))


@pytest.mark.parametrize("length", ["8cm", "8 cm", "80mm", "3.1496062992125986in"])
def test_a_figure_takes_lengths_with_their_units(length: str) -> None:
    figure = Figure(width=length, height=length)  # type: ignore[arg-type]
    assert figure.width == pytest.approx(8.0) == figure.height


@given(st.lists(st.tuples(*[st.floats(-200, 400)] * 3), max_size=4))
def test_a_label_is_in_the_figure_or_told_to_be_missing(points: list[Vector]) -> None:
    labels = [(f"<{n}>", point) for n, point in enumerate(points)]
    shapes = laid_out(np.zeros((1, 1, 4), np.float32), Figure(labels=tuple(labels)), SCENE, surveyed()).shapes
    shown = {shape.text for shape in shapes if isinstance(shape, Words)} & {text for text, _ in labels}
    told = why_unlabelled(labels, SCENE, surveyed())
    assert bool(told) == (len(shown) < len(labels))
    assert all((text in shown) != (text in told) for text, _ in labels)


@given(st.lists(st.tuples(*[st.floats(-200, 400)] * 3), max_size=4))
def test_a_label_is_in_an_image_of_a_movie_or_told_to_be_in_none(points: list[Vector]) -> None:
    labels = [(f"<{n}>", point) for n, point in enumerate(points)]
    turned = turntable(SCENE, HEAD.geometry, 5)
    lacking = [why_unlabelled(labels, scene, surveyed()) for scene in turned]
    told = why_never_labelled(labels, turned, surveyed())
    assert all((text in told) == all(text in why for why in lacking) for text, _ in labels)
    assert bool(told) == any(text in told for text, _ in labels)


@given(
    size=st.tuples(*[st.integers(300, 1600)] * 2),
    labels=st.lists(
        st.tuples(st.sampled_from(["eye", "left orbit", "a suture of the skull"]), st.tuples(*[st.floats(0, 99)] * 3)),
        max_size=4,
    ),
    rotation=quaternions,
    cube=st.booleans(),
)
def test_no_words_over_a_picture_lie_over_others(
    size: tuple[int, int], labels: list[tuple[str, Vector]], rotation: tuple[float, float, float, float], cube: bool
) -> None:
    width, height = size
    view = View(rotation=rotation, zoom=min(size) / 100, up="+z")
    axes = tuple(GridAxis(name, unit, 0.0, 1.0) for name, unit in (("RA", "arcmin"), ("Dec", "arcmin"), ("v", "km/s")))
    volume = surveyed(replace(HEAD, axes=axes, unit="arcmin", anatomical=False) if cube else HEAD)
    figure = Figure(labels=tuple(labels), colour_bar=False)
    shapes = laid_out(
        np.zeros((height, width, 4), np.float32), figure, plain_scene(view=view, size=size), volume
    ).shapes
    boxes = [_inked(shape) for shape in shapes if isinstance(shape, Words)]
    for n, (left, top, right, bottom) in enumerate(boxes):
        assert left >= 0 and top >= 0 and right <= width and bottom <= height
        for other_left, other_top, other_right, other_bottom in boxes[:n]:
            assert right <= other_left or other_right <= left or bottom <= other_top or other_bottom <= top


@given(rotation=quaternions, name=st.sampled_from(["x", "y", "v"]))
def test_a_scale_bar_has_its_row_whichever_others_are_seen(
    rotation: tuple[float, float, float, float], name: str
) -> None:
    axes = tuple(GridAxis(name, unit, 0.0, 1.0) for name, unit in (("x", "deg"), ("y", "K"), ("v", "km/s")))
    volume = surveyed(replace(HEAD, axes=axes, anatomical=False))

    def rows(view: tuple[float, float, float, float]) -> dict[str, float]:
        scene = plain_scene(view=View(rotation=view, zoom=3.0, up="+z"), size=(500, 400))
        shapes = laid_out(PICTURE, Figure(sides=False, colour_bar=False), scene, volume).shapes
        return {shape.text.split()[0]: shape.y for shape in shapes if isinstance(shape, Words)}

    aslant = rows(rotation_from_angles(45.0, 35.0))
    assert len(aslant) == 3
    assert rows(rotation).items() <= aslant.items()


@given(point=st.tuples(st.floats(0, 7), st.floats(0, 8), st.floats(0, 99)), frames=st.integers(2, 30))
def test_in_a_movie_a_label_stays_to_its_side_of_the_voxel_while_there_is_room(point: Vector, frames: int) -> None:
    figure = Figure(labels=(("there", point),), scale_bar=False, sides=False, colour_bar=False)
    scenes = turntable(plain_scene(view=View(zoom=2.0), size=(600, 600)), GEOMETRY, frames)
    drawn_about = FrameFigure(figure, scenes, surveyed())
    ways = set()
    for scene in scenes:
        (line,) = (shape for shape in drawn_about.drawing(PICTURE, scene).shapes if isinstance(shape, Line))
        ways.add((round(line.x1 - line.x0, 3), round(line.y1 - line.y0, 3)))
    assert len(ways) == 1


def test_of_places_without_trouble_the_first_is_taken_and_else_the_one_with_least() -> None:
    room = Room(0, 0, 200, 100)
    room.take([Line(50, 50, 150, 50, 4, (0.0, 0.0, 0.0), None)])
    within, over, beyond = (
        (Words(x, y, "eye", 10, (0.0, 0.0, 0.0), None),) for x, y in ((10.0, 20.0), (60.0, 54.0), (199.0, 54.0))
    )

    def places() -> Iterator[tuple[Words]]:
        yield from (over, within)
        raise AssertionError("what comes after a free place is measured for nothing")

    assert room.best(places()) is within
    assert room.best([over, beyond]) is over


def _inked(words: Words) -> tuple[float, float, float, float]:
    """Left, top, right and bottom of what words cover."""
    wide = width_of(words.text, words.size, words.bold)
    left = words.x - {Anchor.START: 0.0, Anchor.MIDDLE: wide / 2, Anchor.END: wide}[words.anchor]
    return left, words.y - 0.8 * words.size, left + wide, words.y + 0.25 * words.size


def test_a_side_is_told_beside_the_scale_bars_and_not_over_them() -> None:
    """The words of a bar reach beyond the middle of a small picture."""
    axes = tuple(GridAxis(name, "km/s", 0.0, 1.0) for name in ("a velocity with a long name", "y", "z"))
    volume = surveyed(replace(HEAD, axes=axes, anatomical=False))
    shapes = laid_out(
        np.zeros((400, 400, 4), np.float32), Figure(dpi=150), plain_scene(size=(400, 400), view=View(zoom=3)), volume
    ).shapes
    words = {shape.text: _inked(shape) for shape in shapes if isinstance(shape, Words)}
    (bar,) = (box for text, box in words.items() if "long name" in text and "km/s" in text)
    bottom = max((box for text, box in words.items() if text[-1] in "+–−-" and box[3] <= 400), key=lambda box: box[3])
    assert bar[2] > 200 and bottom[0] >= bar[2]
