"""The datasets that a virtual one takes its values from, which part of each a selection needs, and in which files."""

import math
import os
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from volsplat.mapshade_server.readers.arrays.hdf5_file import h5py, hdf5_file
from volsplat.mapshade_server.readers.arrays.hdf5_names import (
    MOST_HOPS,
    SAME_FILE,
    check_way,
    found_beside,
    is_numbered,
)
from volsplat.mapshade_server.readers.reading.file_marks import check_is_file
from volsplat.protocol.text.errors import BadInput

PREFIX = "HDF5_VDS_PREFIX"  # where else HDF5 looks
MOST_WAYS = 100_000  # by which a dataset takes its values through others, or from numbered ones

Part = tuple[range, ...]  # of a dataset, by axis


class _Selected(NamedTuple):
    """What a dataspace selects."""

    box: Part  # which surrounds it
    whole: bool  # all of the box


class _Source(NamedTuple):
    """A dataset, as a file names it."""

    own: Path  # that file
    file: str
    path: str


class _Taken(NamedTuple):
    """What a virtual dataset takes from a source."""

    of: _Selected | None  # the source; None for all of it
    into: _Selected | None  # itself; None if that has no end


class _Way(NamedTuple):
    """From a virtual dataset to a source."""

    to: _Source
    number: int  # among the sources that one mapping names
    numbered: bool  # by %b, as many as there are


class ValueFiles(NamedTuple):
    """Where the values of a dataset lie."""

    files: list[Path]  # that hold them, or lead to them; the file that was asked about first
    # Those that a virtual dataset names, one by one, and that do not hold what it takes from them: HDF5 gives its fill
    # value instead. They are not where HDF5 looks for them, are no HDF5 files, or lack a dataset.
    missing: list[str]


def sources(dataset: Any, wanted: Part) -> Iterator[tuple[Any, Collection[Part]]]:
    """The datasets that a part of a virtual one comes from in the end, each open until the next one is asked for.

    With what is needed of it, or more if that cannot be told. Those that are not there are left out: HDF5 gives its
    fill value instead.
    """
    level = _asked(dataset, [wanted])
    for _ in range(MOST_HOPS):
        onward = defaultdict[_Source, set[tuple[_Taken, Part]]](set)
        for source, one in _opened(level, []):
            parts = {_needed(one, *each) for each in level[source]}
            if not one.is_virtual:
                yield one, parts
                continue
            for further, each in _asked(one, parts).items():
                onward[further] |= each
        level = onward
    if level:
        raise _endless(dataset.file.filename)


def value_files(path: Path, name: str) -> ValueFiles:
    """Of the values of this name in a file.

    Raises BadInput if a dataset takes them from others by far too many ways: HDF5 goes each to read or close it. Those
    that it names one by one itself are as many as its file holds, and do not count.
    """
    passed, named, there = list[Path](), list[_Source](), set[_Source]()
    level, ways = Counter({_Source(path, SAME_FILE, name): 1}), 0
    for hop in range(MOST_HOPS + 1):
        onward = Counter[_Source]()
        for source, one in _opened(level, passed):
            there.add(source)
            passed += _own_files(one)
            for way in _ways(one) if one.is_virtual else ():
                onward[way.to] += level[source]
                ways += level[source] if hop or way.number else 0
                if ways > MOST_WAYS:
                    raise _too_many(path)
                named += [way.to] if not (hop or way.numbered) else []
        level = onward
    if level:
        raise _endless(path)
    missing = [] if PREFIX in os.environ else [source.file for source in named if source not in there]
    files = dict.fromkeys(place.absolute() for place in passed)
    return ValueFiles(list(files), list(dict.fromkeys(missing)))


def _endless(file: object) -> BadInput:
    return BadInput(f"{file}: it takes its values from virtual datasets that take theirs from others, without end")


def _too_many(file: object) -> BadInput:
    return BadInput(
        f"{file}: it takes its values from other datasets by more than {MOST_WAYS} ways, numbered or through each "
        "other; copy them into one dataset"
    )


def _own_files(dataset: Any) -> list[Path]:
    own = Path(dataset.file.filename)
    return [own, *(place for name, _, _ in dataset.external or () if (place := found_beside(own, name)))]


def _asked(dataset: Any, parts: Iterable[Part]) -> Mapping[_Source, set[tuple[_Taken, Part]]]:
    """Of each source that parts of a virtual dataset may need, what is taken for which part."""
    asked = defaultdict[_Source, set[tuple[_Taken, Part]]](set)
    for part in parts:
        for source, taken in _named(dataset, part):
            asked[source].add((taken, part))
    return asked


def _named(dataset: Any, wanted: Part) -> Iterator[tuple[_Source, _Taken]]:
    """The sources that a virtual dataset says it takes what is wanted from."""
    own, told, h5s = Path(dataset.file.filename), dataset.id.get_create_plist(), h5py().h5s
    for n in range(told.get_virtual_count()):  # of which there may be thousands, for each read
        space = told.get_virtual_vspace(n)
        endless = _endless_axis(space, h5s)
        if endless is None and not _is_near(space, wanted):
            continue
        into = _selected(space, h5s) or _Selected(_all_of(dataset), whole=True) if endless is None else None
        taken = _Taken(_selected(told.get_virtual_srcspace(n), h5s), into)
        for source in _sources_of(own, told, n, wanted):
            yield source, taken


def _ways(dataset: Any) -> Iterator[_Way]:
    """To all sources of a virtual dataset."""
    own, told, everything = Path(dataset.file.filename), dataset.id.get_create_plist(), _all_of(dataset)
    for n in range(told.get_virtual_count()):
        by_number = is_numbered(told.get_virtual_filename(n)) or is_numbered(told.get_virtual_dsetname(n))
        for number, source in enumerate(_sources_of(own, told, n, everything)):
            yield _Way(source, number, by_number)


def _sources_of(own: Path, told: Any, n: int, wanted: Part) -> Iterator[_Source]:
    """What the n-th of a virtual dataset's mappings names, each of them if they are numbered without end."""
    file, path, numbers = told.get_virtual_filename(n), told.get_virtual_dsetname(n), range(1)
    if is_numbered(file) or is_numbered(path):
        numbers = _numbers(told.get_virtual_vspace(n), wanted)
    for number in numbers:
        yield _Source(own, _numbered(file, number), _numbered(path, number))


def _opened(level: Iterable[_Source], passed: list[Path]) -> Iterator[tuple[_Source, Any]]:
    """Those datasets that are there, each while it is looked at; the files on the way to them are added to `passed`."""
    by_file = defaultdict[tuple[Path, str], list[_Source]](list)
    for source in level:
        by_file[source.own, source.file].append(source)
    for (own, name), each in by_file.items():
        place = own if name == SAME_FILE else found_beside(own, name)
        if place is None:
            continue
        check_is_file(place)
        if not h5py().is_hdf5(place):
            continue
        with suppress(OSError), hdf5_file(place) as file:  # cut short, it has nothing
            passed.append(place)
            for source in each:
                with suppress(OSError):  # of those that are damaged
                    passed += check_way(file, source.path)
                    if isinstance(one := file.get(source.path), h5py().Dataset):
                        yield source, one


def _endless_axis(space: Any, h5s: Any) -> int | None:
    if space.get_select_type() != h5s.SEL_HYPERSLABS or not space.is_regular_hyperslab():
        return None
    _, _, counts, sizes = space.get_regular_hyperslab()
    if h5s.UNLIMITED not in counts + sizes:
        return None
    return next(n for n, both in enumerate(zip(counts, sizes, strict=True)) if h5s.UNLIMITED in both)


def _is_near(space: Any, wanted: Part) -> bool:
    """Whether what is selected may have something of what is wanted."""
    lows, highs = space.get_select_bounds()
    return all(low < one.stop and one.start <= high for low, high, one in zip(lows, highs, wanted, strict=True))


def _numbers(space: Any, wanted: Sequence[range]) -> range:
    """Of the blocks of a selection without end those that may be wanted."""
    if (axis := _endless_axis(space, h5py().h5s)) is None:
        return range(1)
    starts, strides, _, sizes = space.get_regular_hyperslab()
    if sizes[axis] == h5py().h5s.UNLIMITED:
        return range(1)
    low, high = ((at - starts[axis]) // strides[axis] for at in (wanted[axis].start, wanted[axis].stop - 1))
    return range(max(low, 0), high + 1)


def _numbered(name: str, number: int) -> str:
    """With the block's number for %b; a percent sign is written twice."""
    return "%".join(part.replace("%b", str(number)) for part in name.split("%%"))


def _selected(space: Any, h5s: Any) -> _Selected | None:
    """None for all of it, and if it has no end."""
    if space.get_select_type() == h5s.SEL_ALL or _endless_axis(space, h5s) is not None:
        return None
    box = tuple(range(low, high + 1) for low, high in zip(*space.get_select_bounds(), strict=True))
    return _Selected(box, whole=space.get_select_npoints() == math.prod(map(len, box)))


def _all_of(dataset: Any) -> Part:
    return tuple(map(range, dataset.shape))


def _needed(dataset: Any, taken: _Taken, wanted: Part) -> Part:
    """Of a source. Boxes of equal shapes but for axes of length 1 are read alike."""
    of, into = taken.of or _Selected(_all_of(dataset), whole=True), taken.into
    if into is None or not (into.whole and of.whole):
        return of.box
    axes, sides = ([n for n, side in enumerate(box) if len(side) > 1] for box in (into.box, of.box))
    if [len(into.box[n]) for n in axes] != [len(of.box[n]) for n in sides]:
        return of.box
    needed = list(of.box)
    for axis, side in zip(axes, sides, strict=True):
        common, shift = _common(into.box[axis], wanted[axis]), of.box[side].start - into.box[axis].start
        needed[side] = range(common.start + shift, common.stop + shift)
    return tuple(needed)


def _common(one: range, other: range) -> range:
    return range(max(one.start, other.start), min(one.stop, other.stop))
