"""The text of `volsplat info`: what is known of a volume, with its histogram drawn in characters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from rich.console import Group
from rich.table import Table
from rich.text import Text

from volsplat.client.scene.contour_scenes import contour_level
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES
from volsplat.protocol.description.volume import VolumeDescription
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.rules.index_rules import Survey, percentile, percentiles
from volsplat.protocol.rules.levels import Prepared

NOTE = "note"  # what a row is called that says what the reader had to change or assume
HISTOGRAM_COLUMNS = 64
HISTOGRAM_ROWS = 8
MOST_PARTS = 16  # that are listed
BLOCKS = " ▁▂▃▄▅▆▇█"
PERCENTILES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)

OBLIQUE_DEGREES = 0.1  # below it an axis counts as aligned
LETTERS = (("R", "L"), ("A", "P"), ("I", "S"))  # where a step along a grid axis leads, physical axes being LPS
PLAIN_LETTERS = (("-x", "+x"), ("-y", "+y"), ("-z", "+z"))


class TitledPart(NamedTuple):
    """What names a part of the same file, after the `#`, and what it is."""

    part: str
    title: str


def info_text(known: SurveyedVolume, parts: Sequence[TitledPart] = ()) -> Group:
    """What a person wants to know of a volume before drawing it, for rich's console.

    `parts` are what else can be named of the same file.
    """
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    for name, text in info_rows(known, parts):
        table.add_row(name, Text(text))
    if not known.has_values:
        return Group(table)
    return Group(table, Text(), Text(histogram_text(known.survey, known.density_counts, known.automatic_window)))


def info_rows(known: SurveyedVolume, parts: Sequence[TitledPart] = ()) -> list[tuple[str, str]]:
    """What each row is about, and what there is to say; several may be about the same."""
    description, survey, window = known.description, known.survey, known.automatic_window
    geometry, stands_up = description.geometry, known.stands_up
    unit = f" {description.unit}" if description.unit else " (the file states no unit)"
    no_data = f"{survey.no_data} of {survey.voxels} voxels ({survey.no_data / max(survey.voxels, 1):.2%}), never drawn"
    return [
        ("volume", f"{description.name} ({description.format})"),
        *_kind_rows(description),
        ("dimensions", " x ".join(str(n) for n in geometry.dims) + f" = {math.prod(geometry.dims)} voxels"),
        ("spacing", " x ".join(f"{step:.6g}" for step in geometry.spacing) + unit),
        ("extent", " x ".join(f"{n * d:.5g}" for n, d in zip(geometry.dims, geometry.spacing, strict=True)) + unit),
        ("origin", ", ".join(f"{position:.6g}" for position in geometry.origin)),
        ("orientation", orientation_text(description)),
        ("up", f"{stands_up.up}, {stands_up.why}"),
        *_axis_rows(description),
        ("type", description.scalar_type + (f", in {description.value_unit}" if description.value_unit else "")),
        *_value_rows(known),
        ("NaN", no_data if survey.no_data else "none"),
        ("packet byte 1", f"{description.density_name}: {window[0]:.6g} becomes 0, {window[1]:.6g} becomes 255"),
        ("packet byte 2", description.strength_name + _strength_text(known)),
        ("servers read", _reading_text(description, known.prepared)),
        *_part_rows(parts),
        *((NOTE, warning) for warning in description.warnings),
    ]


def _value_rows(known: SurveyedVolume) -> list[tuple[str, str]]:
    """The values' range and percentiles, and where the default scene has its surface."""
    survey = known.survey
    if not known.has_values:
        return [("range", "no voxel has a value")]
    cuts = percentiles(known.density_counts, survey.ranges.low, survey.ranges.high, PERCENTILES)
    if "int" in known.description.scalar_type:
        cuts = [math.floor(cut) for cut in cuts]  # upper edges of bins narrower than 1
    shown = ", ".join(f"{fraction:.0%}: {cut:.5g}" for fraction, cut in zip(PERCENTILES, cuts, strict=True))
    rows = [("range", f"{survey.low:.7g} to {survey.high:.7g}"), ("percentiles", shown)]
    if (contour := contour_level(known.subject())) is not None:
        rows.append(("contour", f"{contour.value:.5g}, {contour.told}"))
    return rows


def _part_rows(parts: Sequence[TitledPart]) -> list[tuple[str, str]]:
    rows = [("part", f"#{one.part}: {one.title}") for one in parts[:MOST_PARTS]]
    more = len(parts[MOST_PARTS:])
    return [*rows, ("part", f"and {more} more, which --json has")] if more else rows


def _reading_text(description: VolumeDescription, prepared: Prepared | None) -> str:
    if prepared is not None:
        sizes = ", ".join(" x ".join(str(n) for n in level.dims) for level in prepared.levels)
        return f"packets that were made before, of the levels that are drawn: {sizes}"
    if not description.reads_sub_cubes:
        why = f": {description.why_whole}" if description.why_whole else ""
        return f"one of them the whole file, and the others get their sub-cubes from it{why}"
    note = f"; {description.why_whole}" if description.why_whole else ""
    return f"only their sub-cube and its halo{note}"


def _kind_rows(description: VolumeDescription) -> list[tuple[str, str]]:
    """The kind of data, what states it, and its classes."""
    if description.kind == Kind.UNKNOWN:
        return [("kind", "not stated by the file; its histogram decides how it is shown")]
    rows = [("kind", f"{description.kind} ({description.kind_from})")]
    if description.bands:
        told = (
            f"{band.name} {band.low:g}" + (f" to {band.high:g}" if band.high > band.low else "")
            for band in description.bands
        )
        rows.append(("classes", ", ".join(told)))
    return rows


def _axis_rows(description: VolumeDescription) -> list[tuple[str, str]]:
    """What indices stand for, if the file says."""
    if description.axes is None:
        return []
    rows = []
    for letter, axis, count in zip("ijk", description.axes, description.geometry.dims, strict=True):
        last = axis.first + (count - 1) * axis.step
        unit = f" {axis.unit}" if axis.unit else ""
        rows.append((f"{letter} is", f"{axis.name}, {axis.first:.7g} to {last:.7g}{unit}, step {axis.step:.6g}"))
    return rows


def _strength_text(known: SurveyedVolume) -> str:
    """What the byte stands for: 255 for a percentile of the gradients, and for all that are stronger."""
    survey, scale = known.survey, known.strength_scale
    if known.description.second_scalar is not None:
        low, high = known.description.second_scalar
        return f": {low:.6g} becomes 0, {high:.6g} becomes 255"
    if not scale > 0:
        return f", up to {survey.max_gradient:.5g} per unit of length"
    full = (TABLE_ENTRIES - 1) / scale
    told = f": 0 becomes 0, {full:.5g} per unit of length becomes 255"
    if survey.max_gradient > full:
        told += f", and so do stronger ones, up to {survey.max_gradient:.5g}"
    if any(known.strength_counts):
        half = percentile(known.strength_counts, 0.0, survey.ranges.max_gradient, 0.5)
        told += f"; half of the voxels are below {half:.3g}"
    return told


def orientation_text(description: VolumeDescription) -> str:
    """Where steps along i, j, k lead, as letters (LPS: to the left, backwards, up), and what is unusual about it."""
    geometry, anatomical = description.geometry, description.anatomical
    letters = LETTERS if anatomical else PLAIN_LETTERS
    axes = [matrices.normalised(matrices.column(geometry.index_to_physical, axis)) for axis in range(3)]
    towards = matrices.nearest_axes(axes)
    codes = [letters[axis][axes[n][axis] > 0] for n, axis in enumerate(towards)]
    text = "".join(codes) if anatomical else "i, j, k along " + ", ".join(codes)
    notes = []
    tilt = max(math.degrees(math.acos(min(1.0, abs(axes[n][axis])))) for n, axis in enumerate(towards))
    if tilt > OBLIQUE_DEGREES:
        notes.append(f"oblique by {tilt:.1f} degrees")
    bend = max(abs(90 - math.degrees(math.acos(_cosine(axes[a], axes[b])))) for a, b in ((0, 1), (0, 2), (1, 2)))
    if bend > OBLIQUE_DEGREES:
        notes.append(f"skewed by {bend:.1f} degrees")
    if matrices.determinant(geometry.index_to_physical) < 0:
        notes.append("left-handed")
    if not anatomical and description.axes is None and description.unit in ("", "mm"):  # it may be a patient
        notes.append("the file does not say how a patient lies in it")
    return text + "".join(f", {note}" for note in notes)


def _cosine(a: Vector, b: Vector) -> float:
    return max(-1.0, min(1.0, matrices.dot(a, b)))


def histogram_text(survey: Survey, counts: list[int], window: tuple[float, float]) -> str:
    """The histogram as lines of block characters, heights on a logarithmic scale, the density window below."""
    columns = _joined(counts)
    tallest = max(columns)
    heights = [math.log1p(count) / math.log1p(tallest) * HISTOGRAM_ROWS * 8 if count else 0.0 for count in columns]
    lines = []
    for row in reversed(range(HISTOGRAM_ROWS)):
        lines.append("".join(BLOCKS[max(0, min(8, math.ceil(height - 8 * row)))] for height in heights))
    lines[0] += f"  {tallest} voxels"
    lines[-1] += "  (logarithmic)"
    low, high = f"{survey.ranges.low:.6g}", f"{survey.ranges.high:.6g}"
    lines.append("".join(_window_mark(n, survey, window) for n in range(HISTOGRAM_COLUMNS)) + "  density window")
    lines.append(low + high.rjust(HISTOGRAM_COLUMNS - len(low)))
    return "\n".join(line.rstrip() for line in lines)


def _joined(counts: list[int]) -> list[int]:
    """The counts in as many bins as there are columns."""
    columns = [0] * HISTOGRAM_COLUMNS
    for n, count in enumerate(counts):
        columns[n * HISTOGRAM_COLUMNS // len(counts)] += count
    return columns


def _window_mark(column: int, survey: Survey, window: tuple[float, float]) -> str:
    """A stroke under the columns whose middle lies within the window."""
    low, high = survey.ranges.low, survey.ranges.high
    value = low + (high - low) * (column + 0.5) / HISTOGRAM_COLUMNS
    return "─" if window[0] <= value <= window[1] else " "
