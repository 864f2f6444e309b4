"""The datasets that a virtual one takes its values from, which part of each a selection needs, and in which files."""

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from volsplat.mapshade_server.readers.arrays.hdf5_file import h5py, hdf5_file
from volsplat.mapshade_server.readers.arrays.hdf5_names import MOST_HOPS, SAME_FILE, check_way, found_beside


class _Selected(NamedTuple):
    """What a dataspace selects."""

    box: list[range]  # which surrounds it, by axis
    whole: bool  # all of the box


def sources(dataset: Any, wanted: Sequence[range]) -> Iterator[tuple[Any, list[range]]]:
    """Each, open until the next one is asked for, with what is needed of it, or more if that cannot be told.

    Those that are not there are left out: HDF5 gives its fill value instead.
    """
    for source, into, name, path in _named(dataset, wanted):
        for one in _opened(dataset, name, path):
            yield one, _needed(_selected(source.src_space, one.shape), into, wanted)


def value_files(dataset: Any) -> list[Path]:
    """The files that hold its values, or lead to them through virtual datasets; that of the dataset first."""
    found: dict[Path, None] = {}
    seen: set[tuple[str, str]] = set()

    def look(one: Any, hops: int) -> None:
        own = Path(one.file.filename)
        found[own] = None
        found.update((place, None) for name, _, _ in one.external or () if (place := found_beside(own, name)))
        if one.is_virtual and hops and (one.file.filename, one.name) not in seen:
            seen.add((one.file.filename, one.name))
            named = _named(one, [range(length) for length in one.shape])
            for name, path in dict.fromkeys((name, path) for _, _, name, path in named):
                for source in _opened(one, name, path):
                    look(source, hops - 1)

    look(dataset, MOST_HOPS)
    return list(found)


def _named(dataset: Any, wanted: Sequence[range]) -> Iterator[tuple[Any, _Selected | None, str, str]]:
    """What a virtual dataset says of each source that may be needed, what it is put into, its file and path."""
    for source in dataset.virtual_sources():
        endless = _endless_axis(source.vspace)
        into = _selected(source.vspace, dataset.shape) if endless is None else None
        if into is not None and not all(map(_common, into.box, wanted)):
            continue
        for number in [0] if endless is None else _numbers(source.vspace, endless, wanted):
            yield source, into, _numbered(source.file_name, number), _numbered(source.dset_name, number)


def _opened(dataset: Any, name: str, path: str) -> Iterator[Any]:
    """The dataset at a path of a file that a virtual one names, while it is looked at; none if it is not there."""
    own = Path(dataset.file.filename)
    place = own if name == SAME_FILE else found_beside(own, name)
    if place is None or not h5py().is_hdf5(place):
        return
    with suppress(OSError), hdf5_file(place) as file:  # cut short, it has nothing
        check_way(file, path)
        if isinstance(one := file.get(path), h5py().Dataset):
            yield one


def _endless_axis(space: Any) -> int | None:
    if space.get_select_type() != h5py().h5s.SEL_HYPERSLABS or not space.is_regular_hyperslab():
        return None
    _, _, counts, sizes = space.get_regular_hyperslab()
    return next((n for n, both in enumerate(zip(counts, sizes, strict=True)) if h5py().h5s.UNLIMITED in both), None)


def _numbers(space: Any, axis: int, wanted: Sequence[range]) -> range:
    """Of the blocks of a selection without end on this axis those that may be wanted."""
    starts, strides, _, sizes = space.get_regular_hyperslab()
    if sizes[axis] == h5py().h5s.UNLIMITED:
        return range(1)
    low, high = ((at - starts[axis]) // strides[axis] for at in (wanted[axis].start, wanted[axis].stop - 1))
    return range(max(low, 0), high + 1)


def _numbered(name: str, number: int) -> str:
    """With the block's number for %b; a percent sign is written twice."""
    return "%".join(part.replace("%b", str(number)) for part in name.split("%%"))


def _selected(space: Any, shape: Sequence[int]) -> _Selected:
    if space.get_select_type() == h5py().h5s.SEL_ALL:
        return _Selected([range(length) for length in shape], whole=True)
    box = [range(low, high + 1) for low, high in zip(*space.get_select_bounds(), strict=True)]
    return _Selected(box, whole=space.get_select_npoints() == math.prod(map(len, box)))


def _needed(source: _Selected, into: _Selected | None, wanted: Sequence[range]) -> list[range]:
    """Boxes of equal shapes but for axes of length 1 are read alike."""
    if into is None or not (into.whole and source.whole):
        return source.box
    axes, sides = ([n for n, side in enumerate(box) if len(side) > 1] for box in (into.box, source.box))
    if [len(into.box[n]) for n in axes] != [len(source.box[n]) for n in sides]:
        return source.box
    needed = list(source.box)
    for axis, side in zip(axes, sides, strict=True):
        common, shift = _common(into.box[axis], wanted[axis]), source.box[side].start - into.box[axis].start
        needed[side] = range(common.start + shift, common.stop + shift)
    return needed


def _common(one: range, other: range) -> range:
    return range(max(one.start, other.start), min(one.stop, other.stop))
