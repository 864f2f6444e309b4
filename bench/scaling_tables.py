"""What `volsplat bench scaling` shows of its frames: tables, figures and plots."""

from collections.abc import Callable, Sequence

from volsplat.bench.plot import Panel
from volsplat.bench.record import Figure, figure
from volsplat.bench.renderers import SINGLE
from volsplat.bench.scaling_cases import Taken
from volsplat.bench.text_table import TextTable, significant, spread, with_give_or_take
from volsplat.client.bottleneck import bottleneck
from volsplat.client.frame_report import StepReport, this_machine

BASE_BYTES = 250_000_000  # that a process may need for any volume


def servers_table(taken: Sequence[Taken], packed: int, side: int) -> TextTable:
    """One case: a column for each renderer."""
    table = TextTable(
        f"Servers, {side} x {side} pixels",
        ("", *(one.row.name for one in taken)),
        "Efficiency: speed-up by map/shade servers. The splat server waits, with nothing to splat, for the slowest. "
        "Peak memory: of all servers together, over the volume's packed bytes; below it, without the 250 MB "
        "that each may need for any volume. "
        "n servers: n map/shade servers and a splat server.",
    )
    single = next((one.seconds.median for one in taken if one.row.name == SINGLE), None)
    speed_ups = [single / one.seconds.median if single else None for one in taken]
    by_servers = [
        up / one.row.workers if up and one.row.workers else None for up, one in zip(speed_ups, taken, strict=True)
    ]
    table.add("milliseconds a frame", *(significant(one.seconds.median * 1e3) for one in taken))
    table.add("  middle half", *(spread(one.seconds, 1e3) for one in taken))
    table.add("speed-up over single", *(significant(up) if up else "" for up in speed_ups))
    table.add("efficiency", *(significant(share) if share else "" for share in by_servers))
    rows: dict[str, Callable[[Taken], float]] = {
        "million packets/s": lambda one: one.usual.packets_sent / one.usual.wall_seconds / 1e6,
        "MB on the busiest link": lambda one: busiest_link(one.usual) / 1e6 if one.row.workers else 0.0,
        "ms the splat server waits": lambda one: one.usual.splat_waiting_seconds * 1e3,
        "ms of the slowest map/shade": lambda one: one.usual.map_shade_seconds_slowest * 1e3,
        "peak memory / packed bytes": lambda one: peak_bytes(one) / packed if one.row.workers else 0.0,
        "  beyond 250 MB a server": lambda one: bytes_beyond_base(one) / packed if one.row.workers else 0.0,
    }
    for name, value in rows.items():
        table.add(name, *(significant(value(one)) if value(one) else "" for one in taken))
    return table


def growth_table(taken: Sequence[Taken]) -> TextTable:
    """One thing growing: a row for each setting, a column for each renderer."""
    names = list(dict.fromkeys(one.row.name for one in taken))
    title = "Growth: milliseconds a frame"
    caption = f"Medians, with half the width of their middle half. Limited by: of {names[-1]}."
    table = TextTable(title, ("", "M packets", *names, "limited by"), caption)
    for case in dict.fromkeys(one.case for one in taken):
        row = [one for one in taken if one.case == case]
        setting = f"{case.group} {significant(case.value)}" + ("" if "above" in case.group else " M")
        sent = significant(row[-1].usual.packets_sent / 1e6)
        cells = (with_give_or_take(one.seconds, 1e3) for one in row)
        limit = bottleneck(row[-1].usual, this_machine().cores).name
        table.add(setting, sent, *cells, limit)
    return table


def busiest_link(report: StepReport) -> int:
    return max((worker.bytes for worker in report.workers.values()), default=0)


def peak_bytes(taken: Taken) -> int:
    """Of all servers together; the client here also holds the single process's volume."""
    return sum(_server_peaks(taken))


def bytes_beyond_base(taken: Taken) -> int:
    """Of the servers' peaks, what is beyond BASE_BYTES each; negative where they need less."""
    return sum(peak - BASE_BYTES for peak in _server_peaks(taken))


def _server_peaks(taken: Taken) -> list[int]:
    return [peak for name, peak in taken.reports[-1].peak_memory_bytes.items() if name != "client"]


def figures_of(taken: Sequence[Taken], packed: int) -> list[Figure]:
    figures = []
    for one in taken:
        reports = one.reports
        figures += [
            one.seconds,
            figure(f"{one.name}: packets", "1/s", [r.packets_sent / r.wall_seconds for r in reports]),
            figure(f"{one.name}: bytes on the busiest link", "B", [float(busiest_link(r)) for r in reports]),
            figure(f"{one.name}: waiting for the slowest", "s", [r.splat_waiting_seconds for r in reports]),
        ]
        if one.row.workers:
            figures.append(figure(f"{one.name}: peak memory over packed bytes", "", [peak_bytes(one) / packed]))
    return figures


def panels(taken: Sequence[Taken], at_middle: Sequence[Taken]) -> list[Panel]:
    """Time over servers, pixels, voxels and visible voxels."""
    names = list(dict.fromkeys(one.row.name for one in taken))

    def lines(group: str, x: Callable[[Taken], float]) -> dict[str, list[tuple[float | str, float]]]:
        return {
            name: [
                (x(one), one.seconds.median * 1e3) for one in taken if (one.case.group, one.row.name) == (group, name)
            ]
            for name in names
        }

    by_servers: list[tuple[float | str, float]] = [(one.row.name, one.seconds.median * 1e3) for one in at_middle]
    return [
        Panel("servers", "", "milliseconds a frame", {"a frame": by_servers}),
        Panel("pixels", "million pixels", "milliseconds a frame", lines("pixels", lambda one: one.case.value)),
        Panel("voxels", "million voxels", "milliseconds a frame", lines("voxels", lambda one: one.case.value)),
        Panel(
            "visible voxels",
            "million packets sent",
            "milliseconds a frame",
            lines("visible above", lambda one: one.usual.packets_sent / 1e6),
        ),
    ]
