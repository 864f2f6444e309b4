"""Sheets read at once: they partition a box, hold what a sub-cube would, and have every sheet read once."""

from __future__ import annotations

from collections import Counter

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from support.files.prepared import SKEWED, values_of
from volsplat.mapshade_server.held.passed_box import PassedBox
from volsplat.mapshade_server.held.sheet_reader import SheetReader
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box, Geometry, Index

sides = st.integers(1, 17)
indices = st.tuples(sides, sides, sides)


class Counted:
    """A volume that counts which of its voxels are read."""

    def __init__(self, values: Voxels) -> None:
        self._values = values
        self.times = np.zeros(values.shape, int)

    def read(self, box: Box) -> Voxels:
        where = tuple(slice(low, high) for low, high in zip(*box, strict=True))[::-1]
        self.times[where] += 1
        return self._values[where].copy()


@given(dims=indices, chunk=st.tuples(*[st.integers(1, 6)] * 3), bytes_at_once=st.integers(1, 4000), data=st.data())
def test_sheets_partition_a_box_and_hold_what_sub_cubes_do(
    dims: Index, chunk: Index, bytes_at_once: int, data: st.DataObject
) -> None:
    geometry, values = Geometry(dims, SKEWED), values_of("float32", dims)
    ends = [sorted(data.draw(st.tuples(st.integers(0, n), st.integers(0, n)))) for n in dims]
    low, high = zip(
        *((min(a, n - 1), max(b, min(a, n - 1) + 1)) for (a, b), n in zip(ends, dims, strict=True)), strict=True
    )
    box = Box(low, high)
    passed = PassedBox(SheetReader(geometry, "float32", chunk, Counted(values).read, bytes_at_once=bytes_at_once), box)
    held = SubCube.of_volume(geometry, values, box)
    survey = held.survey()
    assert passed.survey() == survey
    counts = (survey.low, survey.high, survey.max_gradient) if survey.low <= survey.high else (0.0, 1.0, 1.0)
    one, other = passed.histograms(*counts), held.histograms(*counts)
    assert one.density.tolist() == other.density.tolist() and one.strength.tolist() == other.strength.tolist()
    assert one.extremes == other.extremes


@given(dims=indices, thick=st.integers(1, 5), sheets=st.integers(1, 7))
def test_every_sheet_is_read_once_and_chunks_are_never_cut(dims: Index, thick: int, sheets: int) -> None:
    volume = Counted(values_of("uint8", dims))
    asked: Counter[int] = Counter()

    def read(box: Box) -> Voxels:
        asked[box.low[2] % thick] += 1
        return volume.read(box)

    reader = SheetReader(
        Geometry(dims), "uint8", (dims[0], 1, thick), read, bytes_at_once=dims[0] * dims[1] * sheets * thick
    )
    readings = list(reader.sheets(Geometry(dims).box))
    assert (volume.times == 1).all() and set(asked) == {0}
    assert max(sheets.values.nbytes for sheets in readings) <= dims[0] * dims[1] * (sheets + 1) * thick
