"""What is done to a table at once: always a valid table, and the one that the menu's words promise."""

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.scenes.scenes import colour_tables, scalar_tables
from tolerances import ROUNDING
from volsplat.client.ui.tables import table_edits
from volsplat.client.ui.tables.table_edits import FREEHAND_BOUND, LAST, MOST_STEPS, Channels, Table
from volsplat.protocol.description.patches import Patch
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES, ColourTable, ScalarTable

tables = colour_tables() | scalar_tables()
units = st.floats(0, 1)
EDITS: dict[str, Callable[[Table], Table]] = {
    "ramp up": table_edits.ramp,
    "ramp down": lambda table: table_edits.ramp(table, rising=False),
    "steps": lambda table: table_edits.steps(table, 7),
    "constant": lambda table: table_edits.constant(table, table_edits.value_at(table, 0.5)),
    "inverted": table_edits.inverted,
    "mirrored": table_edits.mirrored,
    "simplified": table_edits.simplified,
}


def entry_channels(table: Table) -> list[Channels]:
    return [entry if isinstance(entry, tuple) else (entry,) for entry in table.entries()]


def farthest_apart(one: Table, other: Table) -> float:
    pairs = zip(entry_channels(one), entry_channels(other), strict=True)
    return max(abs(a - b) for left, right in pairs for a, b in zip(left, right, strict=True))


def drawn_table(entries: list[Channels]) -> Table:
    """A table as the pencil gives it: one point for each entry."""
    if len(entries[0]) == 1:
        return ScalarTable(points=tuple((n / LAST, value) for n, (value,) in enumerate(entries)))
    return ColourTable(points=tuple((n / LAST, (r, g, b)) for n, (r, g, b) in enumerate(entries)))


@pytest.mark.parametrize("name", EDITS)
@given(table=tables)
def test_every_edit_gives_a_table_of_the_same_kind(name: str, table: Table) -> None:
    edited = EDITS[name](table)  # a table checks itself when it is made
    assert type(edited) is type(table)
    assert all(0.0 <= channel <= 1.0 for entry in entry_channels(edited) for channel in entry)


@given(table=tables)
def test_inverting_or_mirroring_twice_changes_nothing(table: Table) -> None:
    for edit in (table_edits.inverted, table_edits.mirrored):
        twice = edit(edit(table))
        assert len(twice.points) == len(table.points)
        for (position, value), (was_at, was) in zip(twice.points, table.points, strict=True):
            assert position == pytest.approx(was_at, abs=ROUNDING)
            assert value == pytest.approx(was, abs=ROUNDING)


BESIDE_A_STEP = 1e-4  # of the axis
SHIFTED = 1e-3  # a shifted point's position is rounded to 1e-6, which a steep piece shows


@given(table=tables)
def test_a_ramp_runs_over_all_entries(table: Table) -> None:
    rising = entry_channels(table_edits.ramp(table))
    falling = entry_channels(table_edits.ramp(table, rising=False))
    for n in range(TABLE_ENTRIES):
        assert rising[n] == pytest.approx([n / LAST] * len(rising[n]), abs=ROUNDING)
        assert falling[n] == pytest.approx([1 - n / LAST] * len(falling[n]), abs=ROUNDING)


@given(table=tables, bands=st.integers(2, MOST_STEPS))
def test_steps_have_as_many_levels_each_from_the_middle_of_its_band(table: Table, bands: int) -> None:
    stepped = table_edits.steps(table, bands)
    for n, entry in enumerate(entry_channels(stepped)):
        band = min(n * bands // LAST, bands - 1)
        assert entry == pytest.approx(table_edits.value_at(table, (band + 0.5) / bands), abs=ROUNDING)


@pytest.mark.parametrize("bands", [-1, 0, 1, MOST_STEPS + 1])
def test_a_number_of_steps_that_makes_none_is_refused(bands: int) -> None:
    with pytest.raises(ValueError, match=f"steps must be 2 to {MOST_STEPS}, not {bands}"):
        table_edits.steps(ScalarTable(points=((0.0, 0.0), (1.0, 1.0))), bands)


@given(table=scalar_tables(), greatest=units)
def test_all_opacities_scale_to_a_greatest_one(table: ScalarTable, greatest: float) -> None:
    scaled = table_edits.with_greatest(table, greatest)
    if table.greatest == 0:
        assert scaled == table
    else:
        for now, before in zip(scaled.entries(), table.entries(), strict=True):
            assert now == pytest.approx(before / table.greatest * greatest, abs=ROUNDING)


@given(opacities=st.lists(units, min_size=1, max_size=4), greatest=units)
def test_patches_scale_to_a_greatest_opacity(opacities: list[float], greatest: float) -> None:
    patches = tuple(Patch(density=(0.2, 0.4), opacity=opacity) for opacity in opacities)
    scaled = table_edits.patches_with_greatest(patches, greatest)
    if max(opacities) == 0:
        assert scaled == patches
    else:
        expected = [opacity / max(opacities) * greatest for opacity in opacities]
        assert [patch.opacity for patch in scaled] == pytest.approx(expected, abs=ROUNDING)


@given(table=tables, by=st.integers(-LAST, LAST))
def test_a_shifted_table_is_the_same_elsewhere_and_ends_as_it_did(table: Table, by: int) -> None:
    shifted = table_edits.shifted(table, by / LAST)
    assert shifted.points[0][0] >= 0 and shifted.points[-1][0] <= 1
    positions = [position for position, _ in table.points]
    for n in range(TABLE_ENTRIES):
        before = (n - by) / LAST
        if min(abs(before - position) for position in positions) > BESIDE_A_STEP and not is_steep(table, before):
            after = table_edits.value_at(shifted, n / LAST)
            assert after == pytest.approx(table_edits.value_at(table, before), abs=SHIFTED)


def is_steep(table: Table, position: float) -> bool:
    """Whether the table is so steep there that rounding a point's position moves its value."""
    near = (table_edits.value_at(table, position + side * BESIDE_A_STEP) for side in (-1, 1))
    return any(abs(left - right) > 0.1 for left, right in zip(*near, strict=True))


def test_a_table_is_shifted_by_its_points_and_cut_at_the_ends() -> None:
    table = ScalarTable(points=((0.2, 0.0), (0.4, 0.5), (0.8, 0.5), (0.9, 1.0)))
    assert table_edits.shifted(table, 0.0) is table
    for by, points in (
        (0.1, [(0.3, 0.0), (0.5, 0.5), (0.9, 0.5), (1.0, 1.0)]),
        (0.15, [(0.35, 0.0), (0.55, 0.5), (0.95, 0.5), (1.0, 0.75)]),
        (-0.3, [(0.0, 0.25), (0.1, 0.5), (0.5, 0.5), (0.6, 1.0)]),
        (-1.0, [(0.0, 1.0)]),
    ):
        moved = table_edits.shifted(table, by).points
        assert len(moved) == len(points)
        for point, expected in zip(moved, points, strict=True):
            assert point == pytest.approx(expected, abs=ROUNDING)


@given(table=tables, n=st.integers(0, LAST))
def test_the_value_at_an_entry_is_the_entry(table: Table, n: int) -> None:
    assert table_edits.value_at(table, n / LAST) == pytest.approx(entry_channels(table)[n], abs=ROUNDING)


@given(data=st.data())
def test_a_freehand_curve_is_thinned_within_its_bound(data: st.DataObject) -> None:
    colour = data.draw(st.booleans())
    knots = data.draw(st.lists(st.tuples(*[units] * (3 if colour else 1)), min_size=1, max_size=40))
    entries: list[Channels] = [knots[n * len(knots) // TABLE_ENTRIES] for n in range(TABLE_ENTRIES)]
    wobble = data.draw(st.floats(0, FREEHAND_BOUND))  # a hand is not steady
    entries = [tuple(min(1.0, c + wobble * (n % 2)) for c in entry) for n, entry in enumerate(entries)]
    drawn = drawn_table(entries)
    thinned = table_edits.simplified(drawn)
    assert farthest_apart(thinned, drawn) <= FREEHAND_BOUND + ROUNDING
    assert len(thinned.points) <= TABLE_ENTRIES


def test_a_straight_stroke_needs_two_points() -> None:
    assert len(table_edits.simplified(drawn_table([(n / 512,) for n in range(TABLE_ENTRIES)])).points) == 2


@given(table=tables)
def test_a_table_comes_back_from_its_points_as_lists(table: Table) -> None:
    points = [[position, list(value) if isinstance(value, tuple) else value] for position, value in table.points]
    assert table_edits.table_from_points(table, points) == table


@pytest.mark.parametrize(
    "points", [None, [], [[0.5]], [[0.5, 2.0]], [[0.5, "red"]], [[0.9, 0.1], [0.1, 0.1]], [[float("nan"), 0.5]]]
)
def test_points_that_make_no_table_are_refused(points: object) -> None:
    with pytest.raises(ValueError):
        table_edits.table_from_points(ScalarTable(points=((0.0, 0.0),)), points)
