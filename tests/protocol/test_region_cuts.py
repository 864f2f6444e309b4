"""Where images are cut into regions: at tiles, from the first line to the last, and so that all owners have as much."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from support.messages.message_samples import PLAN
from volsplat.protocol.rules.closed_tiles import TILE_SIDE
from volsplat.protocol.rules.region_cuts import cut, expected_work
from volsplat.protocol.rules.regions import Region, check_regions

works = st.lists(st.integers(0, 1000) | st.integers(0, 2**50), max_size=40)
speeds = st.lists(st.floats(1e-3, 1e3) | st.just(1.0), min_size=1, max_size=9)


@given(works, st.integers(1, 300), speeds)
def test_regions_are_cut_at_tiles_and_cover_the_image(work: list[int], lines: int, owners: list[float]) -> None:
    edges = cut(work, lines, owners)
    check_regions([Region(1, *ends) for ends in pairwise(edges)], lines)
    assert len(edges) == len(owners) + 1


@given(works.filter(any), st.integers(1, 9), st.integers(1, TILE_SIDE))
def test_owners_of_one_speed_have_as_much_to_do_as_whole_tiles_allow(work: list[int], owners: int, rest: int) -> None:
    """An edge is at most half a tile off, where the work of the tile is."""
    lines = (len(work) - 1) * TILE_SIDE + rest
    edges = [-(-edge // TILE_SIDE) for edge in cut(work, lines, [2.5] * owners)]
    for begin, end in pairwise(edges):
        assert sum(work[begin:end]) <= sum(work) / owners + max(work) + 1


def test_an_owner_of_twice_the_speed_has_twice_the_work() -> None:
    assert cut([1] * 30, 120, [1.0, 2.0]) == [0, 40, 120]


def test_the_work_of_a_smaller_image_says_where_a_larger_one_has_it() -> None:
    assert cut([0, 0, 8, 8, 0], 200, [1.0, 1.0]) == [0, 120, 200]


def test_where_nothing_is_splatted_lines_count() -> None:
    assert cut([0] * 10, 80, [1.0] * 2) == cut([], 80, [1.0] * 2) == [0, 40, 80]


def test_a_frame_of_which_nothing_is_known_is_expected_to_have_work_where_its_grid_is() -> None:
    work = expected_work(PLAN)
    assert len(work) == -(-PLAN.height // TILE_SIDE) and sum(work) > 0
