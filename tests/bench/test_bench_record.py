"""Records of benchmarks: what a figure is, what moved, and how numbers are told."""

from io import StringIO
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from volsplat.bench.commands.compare_command import comparison, moved
from volsplat.bench.tables.outputs import Outputs
from volsplat.bench.tables.record import Figure, Record, figure, read_record, record, write_record
from volsplat.bench.tables.text_table import LONGEST_NAME, TextTable, significant, with_give_or_take, with_unit
from volsplat.bench.timing import interleaved, ratios
from volsplat.protocol.text.errors import BadInput

samples = st.lists(st.floats(1e-6, 1e6), min_size=1, max_size=20)


def recorded(*figures: Figure) -> Record:
    return record("paper", {"volume": "a head"}, figures)


@given(samples)
def test_a_figure_lies_within_its_middle_half_which_lies_within_its_samples(values: list[float]) -> None:
    one = figure("a frame", "s", values)
    assert min(values) <= one.low <= one.median <= one.high <= max(values)
    assert one.samples == tuple(values)


@given(samples, samples)
def test_moved_does_not_depend_on_which_is_old(a: list[float], b: list[float]) -> None:
    one, other = figure("", "s", a), figure("", "s", b)
    assert moved(one, other) == moved(other, one)


@given(samples)
def test_a_figure_did_not_move_from_itself_but_from_one_beyond_all_its_samples(values: list[float]) -> None:
    one = figure("", "s", values)
    assert not moved(one, one)
    assert moved(one, figure("", "s", [max(values) * 3 + 1] * 3))


def test_a_ratio_is_of_medians_with_what_both_spreads_allow() -> None:
    old, new = Figure("f", "s", 2.0, 1.0, 4.0, (1, 2, 4)), Figure("f", "s", 6.0, 4.0, 8.0, (4, 6, 8))
    (row,) = comparison(recorded(old), recorded(new)).rows
    assert row == ["f", "2.00 s", "6.00 s", "3.00 (1.00–8.00)", "moved"]


@given(st.floats(1e-6, 1e6), st.floats(1e-6, 1e6))
def test_of_two_single_samples_nobody_knows_whether_they_moved(old: float, new: float) -> None:
    one, other = figure("f", "s", [old]), figure("f", "s", [new])
    assert not moved(one, other)
    (row,) = comparison(recorded(one), recorded(other)).rows
    assert row[-2:] == [significant(new / old), "spread unknown"]


def test_only_figures_in_both_records_are_compared_and_the_others_are_counted() -> None:
    old = recorded(figure("a", "s", [1.0]), figure("b", "s", [1.0]), figure("c", "s", [1.0]))
    new = recorded(figure("b", "s", [1.0]), figure("c", "1/s", [1.0]))
    table = comparison(old, new)
    assert [row[0] for row in table.rows] == ["b"]
    assert table.caption.startswith("3 figures")
    with pytest.raises(BadInput, match="no figure in common"):
        comparison(old, recorded(figure("z", "s", [1.0])))


def test_a_record_is_read_as_it_was_written(tmp_path: Path) -> None:
    written = recorded(figure("a", "s", [1.0, 2.0, 5.0]))
    write_record(tmp_path / "a.json", written)
    assert read_record(tmp_path / "a.json") == written


@pytest.mark.parametrize("text", [b"", b"{}", b"\xff", b"[1]", b'{"command": 3}'])
def test_what_is_no_record_is_refused_in_one_line(tmp_path: Path, text: bytes) -> None:
    path = tmp_path / "a.json"
    path.write_bytes(text)
    with pytest.raises(BadInput, match="is no record") as raised:
        read_record(path)
    assert "\n" not in str(raised.value)
    with pytest.raises(BadInput, match="cannot read"):
        read_record(tmp_path / "missing.json")


@given(st.floats(1e-9, 1e12), st.integers(1, 6))
def test_significant_digits_are_those_of_the_number(value: float, digits: int) -> None:
    text = significant(value, digits)
    assert "e" not in text
    assert float(text) == pytest.approx(value, rel=10 ** (1 - digits))


def test_units_have_prefixes() -> None:
    told = [with_unit(*one) for one in ((0.0123, "s"), (15e9, "B/s"), (4.2e7, "1/s"), (1.5, ""), (0.0, "s"))]
    assert told == ["12.3 ms", "15.0 GB/s", "42.0 M/s", "1.50", "0"]


def test_a_figure_of_one_sample_is_told_without_a_spread() -> None:
    assert with_give_or_take(figure("f", "s", [2.0])) == "2.00"
    assert with_give_or_take(figure("f", "s", [1.0, 2.0, 3.0]), 1e3) == "2000 ±25%"


def test_markdown_is_a_table_of_the_same_cells() -> None:
    table = TextTable("Times", ("", "a|b"), "In seconds.")
    table.add("one", "1")
    table.add()
    table.add("two", "2")
    assert table.markdown().splitlines() == [
        "**Times**", "", "|  | a\\|b |", "|---|---:|", "| one | 1 |", "| two | 2 |", "", "In seconds."
    ]  # fmt: skip


@given(st.integers(1, 5), st.integers(1, 7))
def test_contenders_take_turns_and_each_is_measured_once_a_round(contenders: int, rounds: int) -> None:
    ran: list[tuple[int, int]] = []

    def contender(name: int) -> "object":
        def measure(this: int) -> float:
            ran.append((this, name))
            return float(this)

        return measure

    found = interleaved({name: contender(name) for name in range(contenders)}, range(rounds), lambda n: None)  # type: ignore[misc]
    assert found == {name: [float(n) for n in range(rounds)] for name in range(contenders)}
    by_round = [[name for this, name in ran if this == n] for n in range(rounds)]
    assert [n for n, _ in ran] == sorted(n for n, _ in ran)
    assert [order[0] for order in by_round] == [n % contenders for n in range(rounds)]


def test_ratios_are_of_pairs() -> None:
    assert ratios([2.0, 9.0], [1.0, 3.0]) == [2.0, 3.0]


def test_a_record_says_machine_and_version() -> None:
    decoded = msgspec.json.decode(msgspec.json.encode(recorded()))
    assert decoded["machine"].keys() == {"host", "system", "cpu", "cores"} and decoded["volsplat"]


@given(st.integers(1, 12), st.integers(30, 120))
def test_a_table_keeps_every_heading_whole_on_a_narrow_terminal(columns: int, width: int) -> None:
    headings = [f"{n} servers" for n in range(columns)]
    table = TextTable("Servers", ("", *headings), "A caption.")
    table.add("milliseconds", *(f"{n}.5 ±10%" for n in range(columns)))
    console = Console(width=width, file=StringIO())
    console.print(*table.rich(console.width))
    assert isinstance(console.file, StringIO)
    shown = console.file.getvalue()
    assert all(len(line) <= width for line in shown.splitlines())
    for text in (*headings, *(f"{n}.5 ±10%" for n in range(columns))):
        assert text in shown
    assert shown.count("A caption.") == 1


@given(
    st.lists(st.integers(1, 12), min_size=1, max_size=12),
    st.integers(1, LONGEST_NAME),
    st.integers(60, 120),
)
def test_a_row_s_name_is_never_broken_where_a_column_fits_beside_it(widths: list[int], name: int, width: int) -> None:
    table = TextTable("Rates", ("", *("x" * n for n in widths)), "A caption.")
    table.add("n" * name, *("1" * n for n in widths))
    console = Console(width=width, file=StringIO())
    console.print(*table.rich(console.width))
    assert isinstance(console.file, StringIO)
    named = [line for line in console.file.getvalue().splitlines() if "n" * name in line and "1" in line]
    assert [len(cell) for line in named for cell in line.split()[1:]] == widths


class Lost(StringIO):
    """A standard output that is gone."""

    def write(self, text: str) -> int:
        raise OSError("No space left on device")


def test_what_was_measured_is_in_its_files_whatever_else_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found, tables = recorded(figure("a", "s", [1.0])), [TextTable("Times", ("a",), "of one")]
    tables[0].add("1.0 s")
    written = Outputs(tmp_path / "a.json", tmp_path / "a.md")
    monkeypatch.setattr("sys.stdout", Lost())
    with pytest.raises(OSError, match="No space left"):
        written.deliver(found, tables)
    assert read_record(tmp_path / "a.json") == found and "Times" in (tmp_path / "a.md").read_text()
    monkeypatch.undo()
    with pytest.raises(BadInput, match="gone"):
        Outputs(tmp_path / "gone" / "b.json", tmp_path / "b.md").deliver(found, tables)
    assert "Times" in (tmp_path / "b.md").read_text() and "Times" in capsys.readouterr().out
