"""The servers: what each holds, what the last frame cost it, and who waited for whom."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape

from nicegui import context, ui

from volsplat.client.coordinator.server_states import ServerState
from volsplat.client.session.bottleneck import bottleneck
from volsplat.client.session.frame_report import report_of
from volsplat.client.session.renderer import StepOutcome
from volsplat.client.ui.controls.controls import panel_style
from volsplat.client.ui.controls.throttle import Throttle
from volsplat.client.ui.panels.servers.frame_timeline import (
    lanes_of,
    stage_class,
    stages_of,
    stages_shown,
    time_text,
    timeline_svg,
)
from volsplat.client.ui.panels.servers.links_table import links_table, losses_words
from volsplat.client.ui.panels.servers.servers_summary import ServersSummary
from volsplat.client.ui.viewing.picture import Picture
from volsplat.client.ui.viewing.running_step import progress
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.description.volume import Box
from volsplat.protocol.messages.messages import MapShadeStats, SplatStats
from volsplat.protocol.messages.roles import Role

INTERVAL = 0.25  # seconds between updates
HEADS = ("server", "host", "sub-cube", "voxels", "threads", "visible packets")
HEADS_AFTER_STAGES = ("MB/s", "peak MB", "state")

ROLE_WORDS = {Role.MAPSHADE_SERVER: "map/shade", Role.SPLAT_SERVER: "splat server"}


class ServersPanel:
    """A panel at the page's foot, closed at first; while it is closed nothing is worked out for it."""

    def __init__(self, viewing: Viewing) -> None:
        self._viewing = viewing
        self._finished: tuple[Picture, StepOutcome] | None = None  # the newest whose step is finished
        self._build()
        self._throttle = Throttle(INTERVAL, self._show)
        self._expansion.on_value_change(self._ask)
        context.client.on_delete(self._throttle.cancel)
        for unsubscribe in (
            viewing.pictures.subscribe(self._note),
            viewing.model.subscribe(lambda _: self._ask()),
            viewing.troubles.subscribe(lambda _: self._hear()),
        ):
            context.client.on_delete(unsubscribe)
        if viewing.pictures.newest is not None:
            self._note(viewing.pictures.newest)

    def _build(self) -> None:
        panel_style()
        with ui.expansion().classes("vs-servers").props("dense dense-toggle aria-label=Servers") as self._expansion:
            with self._expansion.add_slot("header"), ui.element("div").classes("vs-servers-head"):
                ui.label("Servers")
                self._summary = ServersSummary(self._viewing).classes("vs-muted")
            self._table = ui.html(sanitize=False).classes("vs-servers-table")
            self._losses = ui.label().classes("vs-losses")
            self._links = ui.html(sanitize=False).classes("vs-servers-table vs-links-table")
            with ui.element("div").classes("vs-frame-head"):
                self._said = ui.label().classes("vs-frame-said")
                self._legend = ui.html(legend_keys(stages_shown(None)), sanitize=False).classes("vs-legend")
            self._timeline = ui.html(sanitize=False).classes("vs-frame-lanes")

    def _note(self, picture: Picture) -> None:
        if picture.outcome is not None:
            self._finished = picture, picture.outcome
        self._summary.note(picture)
        self._ask()

    def _hear(self) -> None:
        self._summary.tell()
        self._ask()

    def _ask(self) -> None:
        if self._expansion.value:
            self._throttle()
        else:
            self._throttle.cancel()

    def _show(self) -> None:
        viewing, servers = self._viewing, self._viewing.session.servers
        picture, outcome = self._finished or (None, None)
        self._table.set_content(servers_table(servers, outcome, _drawing(viewing)))
        self._losses.set_text(losses_words(viewing.session.counts.sums()))
        if picture is not None and outcome is not None:
            self._legend.set_content(legend_keys(stages_shown(outcome)))
            self._links.set_content(links_table(outcome))
            names = {server.id: server_name(server) for server in servers}
            self._timeline.set_content(timeline_svg(lanes_of(outcome, names), outcome.wall_seconds))
            self._said.set_text(frame_words(viewing, picture, outcome))


def _drawing(viewing: Viewing) -> bool:
    moving = viewing.loop.pacing.moving.step
    running = progress(viewing.pictures.newest, viewing.model.now, moving).running
    return running is not None and viewing.loop.drawing


def legend_keys(stages: Iterable[str]) -> str:
    """In HTML, what the colours of the time line mean."""
    return "".join(f'<span class="vs-key {stage_class(stage)}"></span><span>{escape(stage)}</span>' for stage in stages)


def frame_words(viewing: Viewing, picture: Picture, outcome: StepOutcome) -> str:
    """What the last frame was, and what held it up."""
    report = report_of(viewing.volume, picture.state.scene, [outcome])
    cause = bottleneck(report.steps[0])
    level = f" · {outcome.servers.why_level}" if outcome.servers.why_level else ""
    return f"last frame: step {outcome.step}, {time_text(outcome.wall_seconds)} · bottleneck: {cause}{level}"


def server_name(server: ServerState) -> str:
    return f"{ROLE_WORDS[server.role]} {server.id}"


def servers_table(servers: list[ServerState], outcome: StepOutcome | None, drawing: bool) -> str:
    """A table in HTML, a row for each server."""
    stages = stages_shown(outcome)
    heads = (*HEADS, *(f"{stage}, ms" for stage in stages), *HEADS_AFTER_STAGES)
    head = "".join(f"<th>{escape(name)}</th>" for name in heads)
    rows = "".join(_row(server, outcome, stages, drawing) for server in servers)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"


def _row(server: ServerState, outcome: StepOutcome | None, stages: Sequence[str], drawing: bool) -> str:
    cells = [server_name(server), _host(server, outcome), "; ".join(box_text(box) for box in server.boxes)]
    cells += [f"{server.voxels:,}" if server.boxes else "", str(server.threads or "")]
    cells += _figures(server, outcome, stages) or [""] * (3 + len(stages))
    state = f"lost: {server.cause}" if server.lost else "drawing" if drawing else "idle"
    kind = "lost" if server.lost else state
    data = "".join(f"<td>{escape(cell)}</td>" for cell in cells)
    return f'<tr class="vs-server-{kind}">{data}<td title="{escape(state)}">{escape(state)}</td></tr>'


def _figures(server: ServerState, outcome: StepOutcome | None, stages: Sequence[str]) -> list[str]:
    """Packets, milliseconds of each stage and megabytes a second of the frame, or nothing if it took no part."""
    servers = _all_stats(server, outcome)
    stats = servers.get(server.id)
    if outcome is None or stats is None or server.lost:
        return []
    seconds = dict(stages_of(stats))
    times = [f"{1000 * seconds[stage]:.1f}" if stage in seconds else "" for stage in stages]
    share = stats.packets / (sum(one.packets for one in servers.values()) or 1)
    rate = f"{stats.bytes / 1e6 / max(outcome.wall_seconds, 1e-9):,.1f}"
    return [f"{stats.packets:,} ({share:.0%})", *times, rate, f"{stats.peak_memory_bytes / 1e6:,.0f}"]


def _all_stats(
    server: ServerState, outcome: StepOutcome | None
) -> Mapping[int, MapShadeStats] | Mapping[int, SplatStats]:
    """Of all servers of its role, in the frame."""
    if outcome is None:
        return {}
    return outcome.servers.map_shade if server.role == Role.MAPSHADE_SERVER else outcome.servers.splat


def _host(server: ServerState, outcome: StepOutcome | None) -> str:
    """Its machine, as far as that is known, and where it dials from."""
    stats = _all_stats(server, outcome).get(server.id)
    return f"{stats.machine.host}, {stats.machine.cores} cores ({server.host})" if stats is not None else server.host


def box_text(box: Box) -> str:
    """The first and the last voxel on every axis."""
    return ", ".join(f"{axis} {low}–{high - 1}" for axis, low, high in zip("ijk", box.low, box.high, strict=True))
