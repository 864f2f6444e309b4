"""What `volsplat bench scaling` shows of its frames: tables, figures and plots."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence

from volsplat.bench.renderers import SINGLE, servers_words
from volsplat.bench.scaling.scaling_cases import Taken
from volsplat.bench.tables.outputs import machine_words
from volsplat.bench.tables.plot import Panel
from volsplat.bench.tables.record import Figure
from volsplat.bench.tables.text_table import TextTable, give_or_take, significant, with_give_or_take
from volsplat.client.session.bottleneck import bottleneck
from volsplat.client.session.frame_report import StepReport

SETTING = "setting"


def servers_table(taken: Sequence[Taken], side: int) -> TextTable:
    """One case: a column for each renderer."""
    table = TextTable(
        f"Servers, {side} x {side} pixels",
        ("", *(one.row.name for one in taken)),
        "1 thread: of a single process. n servers: n map/shade servers and a splat server. Efficiency: the share "
        "reached of n times the speed of the fewest servers. The splat server waits, with nothing to splat, for the "
        "slowest.",
    )
    times = [one.seconds.median for one in taken]
    table.add("milliseconds a frame", *(significant(seconds * 1e3) for seconds in times))
    table.add("", *(give_or_take(one.seconds) for one in taken))
    table.add("speed-up over 1 thread", *_over_one_thread(taken))
    shares = efficiencies({one.row.workers: one.seconds.median for one in taken if one.row.workers})
    table.add("efficiency", *(significant(shares[one.row.workers]) if one.row.workers else "" for one in taken))
    rows: dict[str, Callable[[Taken], float]] = {
        "million packets/s": lambda one: one.usual.packets_sent / one.usual.wall_seconds / 1e6,
        "MB into the splat server": lambda one: one.usual.bytes_sent / 1e6,
        "MB of image out of it": lambda one: one.usual.image_bytes / 1e6,
        "ms the splat server waits": lambda one: one.usual.splat_waiting_seconds * 1e3,
        "ms of the slowest map/shade": lambda one: one.usual.map_shade_seconds_slowest * 1e3,
        "MB of memory, all servers": lambda one: sum(server_peaks(one.usual)) / 1e6,
        "MB of memory, the largest": lambda one: max(server_peaks(one.usual)) / 1e6,
    }
    for name, value in rows.items():
        table.add(name, *(significant(value(one)) if one.row.workers else "" for one in taken))
    return table


def efficiencies(seconds: Mapping[int, float]) -> dict[int, float]:
    """Of each number of servers: the share that it reaches of so many times the speed of the fewest."""
    if not seconds:
        return {}
    fewest = min(seconds)
    return {count: seconds[fewest] * fewest / (taken * count) for count, taken in seconds.items()}


def _over_one_thread(taken: Sequence[Taken]) -> list[str]:
    one_thread = next((one.seconds.median for one in taken if one.row.name == SINGLE), None)
    return [significant(one_thread / one.seconds.median) if one_thread else "" for one in taken]


def growth_table(taken: Sequence[Taken]) -> TextTable:
    """One thing growing: a row for each setting, a column for each renderer."""
    names = list(dict.fromkeys(one.row.name for one in taken))
    title = "Growth: milliseconds a frame"
    caption = f"Medians, with half the width of their middle half. Packets and what limits are of {names[-1]}."
    table = TextTable(title, (SETTING, "M packets", *names, "limited by"), caption)
    for case in dict.fromkeys(one.case for one in taken):
        row = [one for one in taken if one.case == case]
        sent = significant(row[-1].usual.packets_sent / 1e6)
        cells = (with_give_or_take(one.seconds, 1e3) for one in row)
        table.add(case.name, sent, *cells, bottleneck(row[-1].usual).name)
    return table


def sizes_tables(figures: Sequence[Figure]) -> list[TextTable]:
    """Frames by the number of servers, of any number of runs: their milliseconds, and their efficiency."""
    frames = [one for one in figures if one.servers and one.name.endswith(": frame")]
    counts = sorted({one.servers for one in frames if one.servers})
    heads = tuple(servers_words(count) for count in counts)
    times = TextTable(
        "Sizes: milliseconds a frame", (SETTING, *heads), "Medians, with half the width of their middle half."
    )
    shares = TextTable(
        "Sizes: efficiency",
        (SETTING, *heads),
        f"The share reached of n times the speed of {heads[0] if heads else 'the fewest'}.",
    )
    for setting in dict.fromkeys(one.setting for one in frames):
        found = {one.servers: one for one in frames if one.setting == setting and one.servers}
        efficiency = efficiencies({count: one.median for count, one in found.items()})
        times.add(setting, *(with_give_or_take(found[count], 1e3) if count in found else "" for count in counts))
        shares.add(setting, *(significant(efficiency[count]) if count in found else "" for count in counts))
    return [times, shares]


def server_peaks(report: StepReport) -> list[int]:
    """The peak memory of each server, bytes; the client here also holds the single process's volume."""
    return [peak for name, peak in report.peak_memory_bytes.items() if name != "client"]


def figures_of(taken: Sequence[Taken]) -> list[Figure]:
    figures = []
    for one in taken:
        figures += [
            one.seconds,
            one.figure("packets", "1/s", lambda report: report.packets_sent / report.wall_seconds),
            one.figure("bytes into splat servers", "B", lambda report: float(report.bytes_sent)),
            one.figure("bytes of image out of them", "B", lambda report: float(report.image_bytes)),
            one.figure("waiting for the slowest", "s", lambda report: report.splat_waiting_seconds),
        ]
        if one.row.workers:
            figures.append(
                one.figure("peak memory of all servers", "B", lambda report: float(sum(server_peaks(report))))
            )
    return figures


def where_they_run(taken: Taken) -> list[str]:
    """A line for each machine of the servers, with what runs there."""
    report = taken.usual
    mapping, splatting = (
        Counter(server.machine for server in servers.values()) for servers in (report.workers, report.splat_servers)
    )
    lines = []
    for machine in dict.fromkeys([*splatting, *mapping]):
        counts = (("map/shade server", mapping[machine]), ("splat server", splatting[machine]))
        servers = [f"{count} {role}{'s' if count > 1 else ''}" for role, count in counts if count]
        lines.append(f"{machine.host} ({machine_words(machine)}): {' and '.join(servers)}")
    return lines


def link_words(taken: Taken) -> str:
    """What crosses the splat servers' links in a frame, and where it comes from."""
    report = taken.usual
    hosts = list(dict.fromkeys(splat.machine.host for splat in report.splat_servers.values()))
    here = " and ".join(hosts)
    far = [worker for worker in report.workers.values() if [worker.machine.host] != hosts]
    several = len(report.splat_servers) > 1
    into = f"{report.bytes_sent / 1e6:.3g} MB into {'the splat servers' if several else 'the splat server'}"
    out = f"{report.image_bytes / 1e6:.3g} MB of image out of {'them' if several else 'it'}"
    if not far:
        return f"{into} on {here}, all from the same machine; {out}"
    bytes_far = sum(worker.bytes for worker in far)
    rate = max(worker.bytes / worker.sending_seconds for worker in far if worker.sending_seconds) / 1e6
    return f"{into} on {here}, {bytes_far / 1e6:.3g} MB of it from other machines, at up to {rate:.3g} MB/s; {out}"


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
