"""`volsplat bench kernels`: what one core does a second, beside what the machine could do."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import click

from volsplat.bench.tables.outputs import Outputs, output_options
from volsplat.bench.tables.plot import Panel
from volsplat.bench.tables.progress import shown_progress
from volsplat.bench.tables.record import Figure, figure, record
from volsplat.bench.tables.text_table import TextTable, significant, told, with_give_or_take
from volsplat.bench.timing import ratios, thread_seconds
from volsplat.client.command.help_page import helped

if TYPE_CHECKING:
    from volsplat.bench.floors.map_shade_rates import ShareTime, WalkRates
    from volsplat.bench.floors.splat_rates import SplatRates

COPIED_BYTES = 1 << 28
VOLUMES = ("noise", "shells")


@helped("volsplat bench kernels --plot kernels.png")
@click.option("--size", type=click.IntRange(8, 1024), default=256, help="Voxels on each side of the cube (256).")
@click.option("--splats", type=click.IntRange(1000), default=1_000_000, help="In each measurement (1000000).")
@click.option("--rounds", type=click.IntRange(min=1), default=7, help="In each, every contender runs once (7).")
@output_options(plot=True)
def kernels(size: int, splats: int, rounds: int, **settings: Any) -> None:
    """Measure the kernels on one core, on every CPU path, in turns with the machine's floors.

    The floor of splatting adds the same number of weighted samples to the same pixels, that of map/shade reads every
    packet, looks one table up and shades what is visible; both are bare loops (bench/kernels/paths). Times are CPU
    time of the thread.
    """
    outputs = Outputs.of(settings)
    from volsplat.bench import _kernels
    from volsplat.bench.floors.map_shade_rates import PackedVolume, share_times, walk_rates
    from volsplat.bench.floors.splat_rates import SIDES, Rows, splat_rates

    paths = len(_kernels.cpu_paths())
    parts = rounds * (paths * (len(SIDES) * len(Rows) + len(VOLUMES)) + 2)
    with shown_progress("rounds", parts) as step:
        copied = copy_rates(rounds, step)
        splatted = list(splat_rates(splats, rounds, step))
        walked: list[WalkRates] = []
        for name in VOLUMES:
            volume = PackedVolume(name, size)
            walked += walk_rates(volume, rounds, step)
        by_share = share_times(volume, rounds, step)
    tables = [splat_table(splatted), walk_table(walked, size)]
    figures = [copied, *splat_figures(splatted), *walk_figures(walked), *share_figures(by_share)]
    facts = {
        "memory copy": f"{told(copied, 1e-9)} GB/s, one thread, read and written together",
        "rounds": f"{rounds}, medians with the middle half",
        "steady map/shade": share_words(by_share, size),
    }
    outputs.deliver(record("kernels", facts, figures), tables, [splat_panel(splatted), share_panel(by_share)])


def copy_rates(rounds: int, on_round: Callable[[], None]) -> Figure:
    """Bytes a second that one core reads and writes."""
    import torch

    source, target = torch.ones(COPIED_BYTES, dtype=torch.uint8), torch.zeros(COPIED_BYTES, dtype=torch.uint8)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    samples = []
    try:
        for _ in range(rounds):
            samples.append(2 * COPIED_BYTES / thread_seconds(lambda: target.copy_(source)))
            on_round()
    finally:
        torch.set_num_threads(threads)
    return figure("memory copy", "B/s", samples)


def splat_table(found: Sequence[SplatRates]) -> TextTable:
    table = TextTable(
        "Splat: million splats a second on one core",
        ("pixels", "rows", "path", "btf", "ftb", "bare loop", "M pixels/s", "btf / bare", "ftb / bare"),
        "Medians. rows: on the screen they are level, as in views without roll, or lean by a tenth. btf: back to "
        "front; ftb: front to back. M pixels/s: of btf. Ratios: of what was measured in turns, with half the width of "
        "their middle half.",
    )
    for one in found:
        medians = [figure("", "", values).median for values in one.rates.values()]
        rates = (significant(rate / 1e6) for rate in (*medians, medians[0] * one.side**2))
        shares = (with_give_or_take(figure("", "", share), digits=2) for share in one.over_floor().values())
        table.add(f"{one.side}x{one.side}", one.rows.name.lower(), one.path, *rates, *shares)
    return table


def walk_table(found: Sequence[WalkRates], size: int) -> TextTable:
    table = TextTable(
        f"Map/shade: million voxels a second on one core, {size} x {size} x {size}",
        ("volume", "path", "looked up", "i", "j", "k", "bare loop", "i / bare"),
        "Medians, by the axis that samples follow. all: every packet, in the first frame of new tables. visible: in "
        "the frames after.",
    )
    for one in found:
        bare = significant(figure("", "", one.floor).median / 1e6)
        for name, rates in (("all", one.every_voxel), ("visible", one.steady)):
            axes = (significant(figure("", "", rates[view]).median / 1e6) for view in rates)
            share = told(figure("", "", ratios(rates["i"], one.floor)), digits=2)
            table.add(one.volume, one.path, name, *axes, bare, share)
    return table


def splat_figures(found: Sequence[SplatRates]) -> list[Figure]:
    figures = []
    for one in found:
        what = f"{one.side}x{one.side}, {one.rows.name.lower()}, {one.path}"
        figures += [figure(f"splat {what}, {name}", "1/s", values) for name, values in one.rates.items()]
        figures += [figure(f"splat {what}, {order} over bare", "", share) for order, share in one.over_floor().items()]
        figures.append(figure(f"pixels of {what}, btf", "1/s", [rate * one.side**2 for rate in one.rates["btf"]]))
    return figures


def walk_figures(found: Sequence[WalkRates]) -> list[Figure]:
    figures = []
    for one in found:
        start = f"map/shade {one.volume}, {one.path}"
        figures.append(figure(f"{start}, bare loop", "1/s", one.floor))
        for name, rates in (("every voxel", one.every_voxel), ("steady", one.steady)):
            figures += [figure(f"{start}, {name} along {view}", "1/s", values) for view, values in rates.items()]
            figures.append(figure(f"{start}, {name} along i over bare", "", ratios(rates["i"], one.floor)))
    return figures


def share_figures(found: Sequence[ShareTime]) -> list[Figure]:
    return [figure(f"map/shade steady, {one.visible:.1%} visible", "s", one.seconds) for one in found]


def share_line(found: Sequence[ShareTime]) -> tuple[float, float]:
    """Seconds of a frame with nothing visible, and with everything, by the straight line nearest to the medians."""
    seconds = [figure("", "s", one.seconds).median for one in found]
    slope, intercept = statistics.linear_regression([one.visible for one in found], seconds)
    return intercept, intercept + slope


def share_words(found: Sequence[ShareTime], size: int) -> str:
    """Whether time is proportional to visible voxels."""
    nothing, everything = share_line(found)
    each = (everything - nothing) / size**3
    return f"{nothing * 1e3:.2f} ms a frame and {each * 1e9:.2f} ns a visible voxel, from {len(found)} shares"


def splat_panel(found: Sequence[SplatRates]) -> Panel:
    from volsplat.bench.floors.splat_rates import Rows

    lines: dict[str, list[tuple[float | str, float]]] = {}
    for one in (one for one in found if one.rows == Rows.LEVEL):
        for name, values in one.rates.items():
            if name != "ftb":
                rate = figure("", "", values).median / 1e6
                lines.setdefault(f"{one.path}, {name}", []).append((one.side, rate))
    return Panel(
        "splats a second on one core, level rows", "pixels on a footprint's side", "million a second", lines, True
    )


def share_panel(found: Sequence[ShareTime]) -> Panel:
    measured: list[tuple[float | str, float]] = [
        (100 * one.visible, figure("", "s", one.seconds).median * 1e3) for one in found
    ]
    nothing, everything = share_line(found)
    fitted: list[tuple[float | str, float]] = [
        (100 * share, (nothing + share * (everything - nothing)) * 1e3) for share in (0.0, found[-1].visible)
    ]
    title, x, y = "map/shade of a steady frame, shells", "% of the voxels visible", "milliseconds"
    return Panel(title, x, y, {"nearest line": fitted, "measured": measured}, faint=("nearest line",))
