"""Stacks DICOM frames by their positions, never by their names, and tells frames at one place apart.

The place in space is made from the frames' own tags, so that a tilted gantry stays a shear. A missing or misplaced
slice is reported instead of drawn; slices that are unevenly spaced on purpose are resampled along their normal.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np

from volsplat.mapshade_server.readers.medicine.dicom_file import APART, CLOCKS, DicomFile, Frame, Place
from volsplat.mapshade_server.readers.reading.grids import checked_geometry
from volsplat.mapshade_server.readers.reading.part_options import listed
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box, Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix, Vector
from volsplat.protocol.text.errors import BadInput

GAP_TOLERANCE = 0.02  # of the usual distance of slices; scanners round positions to a few decimals
SAME_PLACE = 1e-3  # of the greatest distance of slices
ORIENTATION_TOLERANCE = 1e-3  # of a direction cosine
BESIDE_TOLERANCE = 0.25  # of a pixel
FINEST_STEP = 0.25  # of the usual distance of slices, when they are resampled
ORIENTATIONS = ("sagittal", "coronal", "axial")  # by the axis that the normal is closest to
ORIENTATION = "orientation"
TYPE = "type"
KEYS = (ORIENTATION, *APART)
MOST_ORIENTATIONS = 64  # of stacks in one series: each frame is compared with all
MOST_SHOWN = 5

Name = tuple[tuple[str, str], ...]  # keys and values that set a group of frames apart
Groups = dict[Name, list[Frame]]


@dataclass(frozen=True)
class Stack:
    """Frames in order, and their grid. `heights` has each frame's place in grid steps if they are resampled."""

    frames: tuple[Frame, ...]
    geometry: Geometry
    anatomical: bool
    unit: str
    warnings: tuple[str, ...]
    heights: tuple[float, ...] | None = None

    def read(self, scalar_type: str, box: Box) -> Voxels:
        """The voxels of a box; only the frames that it needs are read, and of unpacked ones only its rows."""
        voxels: Voxels = np.empty(box.size[::-1], scalar_type)
        if self.heights is None:
            for n, frame in enumerate(self.frames[box.low[2] : box.high[2]]):
                voxels[n] = frame.read(box)
            return voxels
        heights = np.array(self.heights)
        read: dict[int, Voxels] = {}
        for n, k in enumerate(range(box.low[2], box.high[2])):
            # Between the two slices around the sheet, by the share of the way from one to the other.
            above = int(np.clip(np.searchsorted(heights, k), 1, len(heights) - 1))
            share = float(np.clip((k - heights[above - 1]) / (heights[above] - heights[above - 1]), 0, 1))
            around = (above - 1, above)
            read = {m: read[m] if m in read else self.frames[m].read(box).astype(np.float64) for m in around}
            between = (1 - share) * read[above - 1] + share * read[above]
            voxels[n] = between if voxels.dtype.kind == "f" else np.rint(between)
        return voxels


def apart(source: Path, frames: Sequence[Frame]) -> Groups:
    """The frames in groups that may be volumes, by what sets each apart from the others.

    Frames that are turned differently, or lie at one place, belong to different volumes. Raises BadInput if they are
    turned in more than MOST_ORIENTATIONS ways.
    """
    labels = _orientations(source, frames)
    groups: Groups = {}
    if len(set(labels)) > 1:
        for frame, label in zip(frames, labels, strict=True):
            groups.setdefault(((ORIENTATION, label),), []).append(frame)
    else:
        groups[()] = list(frames)
    for key in APART:
        if all(_collisions(group) == 0 for group in groups.values()):
            break
        split: Groups = {}
        for name, group in groups.items():
            split.update(_split(name, group, key))
        groups = split
    return groups


def _split(name: Name, group: list[Frame], key: str) -> Groups:
    """The group by the values of `key`, if frames at one place differ in it, else as it is.

    By the clock only into parts that have a frame at each place.
    """
    parts = _parts(group, key)
    if len(parts) == 1 or sum(_collisions(part) for part in parts.values()) == _collisions(group):
        return {name: group}
    if key in CLOCKS and any(_places(part) != _places(group) for part in parts.values()):
        return {name: group}
    return {(*name, (key, value)): part for value, part in parts.items()}


def _parts(frames: Sequence[Frame], key: str) -> dict[str, list[Frame]]:
    """The frames by what they say of `key`."""
    parts: dict[str, list[Frame]] = {}
    values = [frame.apart.get(key, ()) for frame in frames]
    for frame, words in zip(frames, _different_words(values) if key == TYPE else values, strict=True):
        parts.setdefault("/".join(words) or "none", []).append(frame)
    return parts


def _different_words(values: Sequence[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Each value without the words that all share at one place, as ORIGINAL and PRIMARY of a type of image."""
    if len({len(words) for words in values}) > 1:
        return list(values)
    kept = [n for n, words in enumerate(zip(*values, strict=True)) if len(set(words)) > 1]
    return [tuple(words[n] for n in kept) for words in values]


def _collisions(frames: Sequence[Frame]) -> int:
    """How many frames lie where another one does."""
    return sum(frame.place is not None for frame in frames) - len(_places(frames))


def _places(frames: Sequence[Frame]) -> set[tuple[float, ...]]:
    return {_rounded(frame.place) for frame in frames if frame.place is not None}


def _rounded(place: Place) -> tuple[float, ...]:
    return tuple(round(x, 3) for x in place.position)


def _orientations(source: Path, frames: Sequence[Frame]) -> list[str]:
    """What a person calls each frame's orientation; several of one name are numbered."""
    known: list[tuple[Place, str]] = []
    labels = []
    for frame in frames:
        place = frame.place
        label = ""
        if place is not None:
            label = next((name for other, name in known if _parallel(place, other)), "")
            if not label and len(known) == MOST_ORIENTATIONS:
                raise BadInput(
                    f"{source}: its frames are turned in more than {MOST_ORIENTATIONS} ways, so they are no stacks; "
                    "give a series of parallel slices"
                )
            if not label:
                normal = [abs(x) for x in place.normal]
                base = ORIENTATIONS[normal.index(max(normal))]
                alike = sum(name.split("-")[0] == base for _, name in known)
                label = f"{base}-{alike + 1}" if alike else base
                known.append((place, label))
        labels.append(label)
    return labels


def _parallel(one: Place, other: Place) -> bool:
    pairs = zip(
        (*one.row_direction, *one.column_direction), (*other.row_direction, *other.column_direction), strict=True
    )
    return max(abs(a - b) for a, b in pairs) <= ORIENTATION_TOLERANCE


def stacked(source: Path, frames: Sequence[Frame], file: DicomFile) -> Stack:
    """Two frames or more as one volume. Raises BadInput if they are none: of several sizes, or some missing."""
    first = frames[0]
    for frame in frames[1:]:
        if (frame.pixels.columns, frame.pixels.rows, frame.spacing) != (
            first.pixels.columns,
            first.pixels.rows,
            first.spacing,
        ):
            raise BadInput(
                f"{source}: slices {first.name} and {frame.name} differ in size or pixel spacing; "
                "put one series alone into a folder"
            )
    placed = [(frame, frame.place) for frame in frames if frame.place is not None]
    if len(placed) == len(frames):
        return _by_position(source, placed)
    if placed or not file.ordered:
        odd = next(frame for frame in frames if frame.place is None)
        raise BadInput(
            f"{source}: {odd.name} has no usable ImagePositionPatient, so it has no place in a series; a film of one "
            "slice is no volume, else export it again"
        )
    return _in_file_order(source, frames)


def single(source: Path, frame: Frame) -> Stack:
    """One frame as a volume of one slice, as thick as the file states, else as wide as its pixels."""
    dims = (frame.pixels.columns, frame.pixels.rows, 1)
    place = frame.place
    thick = abs(frame.thickness or frame.between_slices)
    if place is None:
        told = "the file states no place of its slice"
        if not any(frame.spacing):
            return _unplaced(source, (frame,), 0.0, f"{told}, and no size of its pixels")
        return _unplaced(source, (frame,), thick, told)
    between_rows, between_columns = frame.spacing
    thick = thick or min(frame.spacing)
    columns = (
        matrices.scaled(place.row_direction, between_columns),
        matrices.scaled(place.column_direction, between_rows),
        matrices.scaled(place.normal, thick),
    )
    geometry = checked_geometry(source, dims, matrices.transposed(columns), place.position)
    return Stack((frame,), geometry, True, "mm", ())


def _in_file_order(source: Path, frames: Sequence[Frame]) -> Stack:
    """Frames of a 3-D acquisition whose places were removed, as some programs do that remove names."""
    first = frames[0]
    step = abs(first.between_slices or first.thickness)
    apart = f"{step:g} mm apart" if step else "one pixel apart"
    if step and not first.between_slices:
        apart += ", as thick as they are"
    down, across = first.spacing
    pixels = f"{across:g} x {down:g} mm" if any(first.spacing) else "1 mm"
    told = (
        "the file states no places of its frames, likely removed: they are stacked in their order, "
        f"{apart}, with pixels of {pixels}; left and right cannot be told"
    )
    return _unplaced(source, frames, step, told)


def _unplaced(source: Path, frames: Sequence[Frame], step: float, told: str) -> Stack:
    """Frames in this order, `step` mm apart, or as far as pixels are, which are of 1 mm if no size is stated."""
    first = frames[0]
    stated = any(first.spacing)
    down, across = first.spacing if stated else (1.0, 1.0)
    matrix: Matrix = ((across, 0.0, 0.0), (0.0, down, 0.0), (0.0, 0.0, step or min(across, down)))
    geometry = checked_geometry(source, (first.pixels.columns, first.pixels.rows, len(frames)), matrix)
    return Stack(tuple(frames), geometry, False, "mm" if stated else "", (told,))


def _by_position(source: Path, placed: Sequence[tuple[Frame, Place]]) -> Stack:
    normal = placed[0][1].normal
    in_order = sorted(placed, key=lambda one: matrices.dot(one[1].position, normal))
    frames = tuple(frame for frame, _ in in_order)
    heights = [matrices.dot(place.position, normal) for _, place in in_order]
    first, last = in_order[0][1], in_order[-1][1]
    even = _check_gaps(source, frames, heights)
    _check_line(source, in_order, heights)
    count = len(frames) if even else _even_count(heights)
    step = matrices.scaled(matrices.minus(last.position, first.position), 1 / (count - 1))
    between_rows, between_columns = frames[0].spacing
    matrix: Matrix = matrices.transposed(
        (
            matrices.scaled(first.row_direction, between_columns),
            matrices.scaled(first.column_direction, between_rows),
            step,
        )
    )
    dims = (frames[0].pixels.columns, frames[0].pixels.rows, count)
    geometry = checked_geometry(source, dims, matrix, first.position)
    if even:
        return Stack(frames, geometry, True, "mm", ())
    apart = (heights[-1] - heights[0]) / (count - 1)
    gaps = [after - before for before, after in zip(heights, heights[1:], strict=False)]
    told = f"slices are unevenly spaced ({min(gaps):g} to {max(gaps):g} mm); resampled to {apart:g} mm"
    return Stack(frames, geometry, True, "mm", (told,), tuple((height - heights[0]) / apart for height in heights))


def _check_gaps(source: Path, frames: Sequence[Frame], heights: Sequence[float]) -> bool:
    """Whether slices are evenly spaced. Raises BadInput if two lie at one place, or one is missing."""
    gaps = [after - before for before, after in zip(heights, heights[1:], strict=False)]
    usual = median(gaps)
    _check_apart(source, frames, gaps, usual)
    thick = median(frame.thickness for frame in frames)
    for n, gap in enumerate(gaps):
        between = f"{frames[n].name} and {frames[n + 1].name}"
        steps = round(gap / usual)
        missing = steps > 1 and abs(gap - steps * usual) <= GAP_TOLERANCE * gap
        thicker = thick > 0 and max(frames[n].thickness, frames[n + 1].thickness) >= (1 - GAP_TOLERANCE) * steps * thick
        if missing and not thicker:
            count = f"{steps - 1} slices are" if steps > 2 else "a slice is"
            raise BadInput(
                f"{source}: {count} missing: {between} are {gap:g} mm apart, the others {usual:g} mm; "
                "complete the series"
            )
    return all(abs(gap - usual) <= GAP_TOLERANCE * usual for gap in gaps)


def _check_apart(source: Path, frames: Sequence[Frame], gaps: Sequence[float], usual: float) -> None:
    """Raises BadInput if two frames lie at one place."""
    if max(gaps) == 0 and len({frame.pixels.path for frame in frames}) == 1:
        raise BadInput(
            f"{source}: has {len(frames)} frames and one place for all of them: a film of one slice is no volume, else "
            "export it again with the place of each"
        )
    real = usual if usual > SAME_PLACE * max(gaps) else max(gaps)  # else most frames lie where another one does
    for n, gap in enumerate(gaps):
        if gap <= GAP_TOLERANCE * real:
            raise BadInput(
                f"{source}: slices {frames[n].name} and {frames[n + 1].name} lie at one position and "
                f"{_why_together(frames)}, or put one phase of the series into a folder"
            )


def _why_together(frames: Sequence[Frame]) -> str:
    """Why frames at one place stand in one volume, and the cure."""
    count = len(_places(frames))
    for key in CLOCKS:
        parts = _parts(frames, key)
        if len(parts) > 1 and all(len(part) == len(_places(part)) > 1 for part in parts.values()):
            held = [f"{key}={value} has {len(part)} of {count}" for value, part in parts.items() if len(part) < count]
            return f"{key} tells volumes apart, but slices are missing: {listed(held)}; complete the series"
    return "nothing tells them apart; remove copies"


def _check_line(source: Path, in_order: Sequence[tuple[Frame, Place]], heights: Sequence[float]) -> None:
    """Raises BadInput for a slice that is shifted within its plane against the line through first and last."""
    first, last = in_order[0][1].position, in_order[-1][1].position
    along = matrices.scaled(matrices.minus(last, first), 1 / (heights[-1] - heights[0]))
    most = BESIDE_TOLERANCE * min(in_order[0][0].spacing)
    for (frame, place), height in zip(in_order, heights, strict=True):
        expected: Vector = matrices.plus(first, matrices.scaled(along, height - heights[0]))
        beside = matrices.length(matrices.minus(place.position, expected))
        if beside > most:
            raise BadInput(
                f"{source}: slice {frame.name} lies {beside:.3g} mm beside the line of the others; "
                "put one stack alone into a folder"
            )


def _even_count(heights: Sequence[float]) -> int:
    """How many even slices keep both ends and the finest distance there is, within reason."""
    gaps = [after - before for before, after in zip(heights, heights[1:], strict=False)]
    step = max(min(gaps), FINEST_STEP * median(gaps))
    return math.ceil((heights[-1] - heights[0]) / step - GAP_TOLERANCE) + 1


def choices(groups: Iterable[Name]) -> dict[str, list[str]]:
    """What is to be chosen between the groups: each key with its values, in the order of the frames."""
    found: dict[str, list[str]] = {}
    for name in groups:
        for key, value in name:
            found.setdefault(key, [])
            if value not in found[key]:
                found[key].append(value)
    return {key: values for key, values in found.items() if len(values) > 1}


def told(found: Mapping[str, Sequence[str]]) -> str:
    """The choices in words: 3 by time (time=1, time=2, time=3)."""
    return " and ".join(
        f"{len(values)} by {key} ({', '.join(f'{key}={value}' for value in values[:MOST_SHOWN])}"
        f"{', …' if len(values) > MOST_SHOWN else ''})"
        for key, values in found.items()
    )
