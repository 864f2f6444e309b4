"""The division of the grid into sub-cubes."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from volsplat.client.coordinator.sub_cubes import divided
from volsplat.protocol.description.volume import Box, Geometry
from volsplat.protocol.geometry.matrices import Matrix, Vector
from volsplat.protocol.text.errors import BadInput

sides = st.integers(1, 12)
spacings = st.floats(0.1, 10)


@given(dims=st.tuples(sides, sides, sides), spacing=st.tuples(spacings, spacings, spacings), data=st.data())
def test_sub_cubes_partition_the_grid(
    dims: tuple[int, int, int], spacing: tuple[float, float, float], data: st.DataObject
) -> None:
    geometry = Geometry(dims, upright(spacing))
    boxes = divided(geometry, data.draw(st.integers(1, min(geometry.box.voxels, 40))))
    voxels = [voxel for box in boxes for voxel in voxels_of(box)]
    assert len(set(voxels)) == len(voxels) == geometry.box.voxels
    assert all(box.voxels > 0 for box in boxes)


def upright(spacing: Vector) -> Matrix:
    """The grid's steps along the physical axes."""
    x, y, z = spacing
    return ((x, 0.0, 0.0), (0.0, y, 0.0), (0.0, 0.0, z))


def voxels_of(box: Box) -> list[tuple[int, int, int]]:
    (i0, j0, k0), (i1, j1, k1) = box.low, box.high
    return [(i, j, k) for k in range(k0, k1) for j in range(j0, j1) for i in range(i0, i1)]


def test_the_longest_edge_is_halved_in_length_not_in_voxels() -> None:
    boxes = divided(Geometry((64, 32, 16), upright((1.0, 1.0, 5.0))), 2)
    assert [box.size for box in boxes] == [(64, 32, 8), (64, 32, 8)]


@pytest.mark.parametrize("parts, size", [(2, (16, 8, 16)), (4, (8, 8, 16)), (8, (8, 8, 8))])
def test_of_equal_edges_k_is_halved_last(parts: int, size: tuple[int, int, int]) -> None:
    assert {box.size for box in divided(Geometry((16, 16, 16)), parts)} == {size}


def test_there_are_no_more_sub_cubes_than_voxels() -> None:
    with pytest.raises(BadInput, match="9 map/shade servers cannot share 8 voxels"):
        divided(Geometry((2, 2, 2)), 9)


@pytest.mark.parametrize("parts, size", [(2, (16, 8, 16)), (4, (16, 8, 8)), (8, (16, 4, 8)), (32, (16, 2, 4))])
def test_rows_of_a_file_are_left_whole(parts: int, size: tuple[int, int, int]) -> None:
    assert {box.size for box in divided(Geometry((16, 16, 16)), parts, (16, 1, 1))} == {size}


def test_what_comes_together_is_cut_where_nothing_else_is_left() -> None:
    assert {box.size for box in divided(Geometry((16, 16, 16)), 4, (16, 16, 16))} == {(8, 8, 16)}
    assert {box.size for box in divided(Geometry((16, 1, 1)), 4, (16, 1, 1))} == {(4, 1, 1)}
