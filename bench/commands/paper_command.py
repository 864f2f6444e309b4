"""`volsplat bench paper`: the paper's timing table beside this machine's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import click

from volsplat.bench.clusters.cluster_sizes import Drawers, MeasuredCluster, groups_of
from volsplat.bench.clusters.cluster_table import cluster_facts, cluster_table, links_table
from volsplat.bench.commands.drawers import cluster_option, drawers_from_options
from volsplat.bench.renderers import SINGLE, Row, threads_of_each
from volsplat.bench.scaling.scaling_cases import Case, Taken, frames_of
from volsplat.bench.subject import Shares, Subject, shares, subject_options, volume_file, volume_words
from volsplat.bench.tables.outputs import Outputs, machine_words, output_options
from volsplat.bench.tables.plot import Panel
from volsplat.bench.tables.progress import shown_progress
from volsplat.bench.tables.record import Figure, figure, record
from volsplat.bench.tables.text_table import TextTable, give_or_take, significant
from volsplat.bench.timing import interleaved
from volsplat.bench.views import around, seen
from volsplat.client.command.help_page import helped
from volsplat.client.command.render_options import size_from_option
from volsplat.client.command.side_console import SideConsole
from volsplat.client.session.frame_report import PAPER_SECONDS, STEP_WORDS
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.program.this_machine import this_machine
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.rules.refinement import PAPER_STEPS

# Rows of the paper whose ratio says what more machines brought: above, below.
PAPER_SPEED_UPS = (("4 Sun-3", "1 Sun-3"), ("4 Sun-4", "1 Sun-4"), ("TAAC-1", "1 Sun-3"))
USUAL_WORKERS = "1,2,4"
CAPTION = (
    "Seconds from asking for a step's image to having it, each image by itself and none added up; so are the paper's "
    "(its E follows its D by less than its C, the same voxels without a kernel, takes). "
    "The paper's volume is a CT of 96 x 128 x 113 voxels. "
    "n servers: n map/shade servers and a splat server. Medians, with half the width of their middle half."
)

Seconds = Mapping[tuple[str, Step], list[float]]


@helped("volsplat bench paper head.nrrd", "volsplat bench paper head.nrrd --workers 1,2 --plot times.png")
@subject_options
@click.option("--size", default="512x512", metavar="WxH", help="Image size in pixels (512x512).")
@click.option("--workers", help="Numbers of map/shade servers (1,2,4; of a cluster those of 1, 2, 3 … machines).")
@cluster_option
@click.option("--repeats", type=click.IntRange(min=1), default=7, help="Views; each step is drawn once in each (7).")
@output_options(plot=True)
def paper(size: str, workers: str | None, cluster: Path | None, repeats: int, **settings: Any) -> None:
    """Print the paper's timing table with rows of this machine: the single process and several numbers of servers.

    Every repeat is another view, in which the steps A to F are drawn one after the other. With --cluster the rows are
    of its first machine, of the first two and so on, each brought up for its row; another table has bytes and limits.
    """
    subject = Subject.of(settings, here=cluster is None)
    pixels, drawers = size_from_option(size), drawers_from_options(cluster, workers, USUAL_WORKERS)
    outputs = Outputs.of(settings)
    found = measured(subject, drawers, pixels, repeats)
    image = f"{pixels[0]} x {pixels[1]}"
    facts = {
        "volume": volume_words(found.volume),
        "tables": subject.tables.value,
        "image": f"{image} pixels, {repeats} views",
        "shares": str(found.shares),
        **cluster_facts(found.taken),
    }
    names = list(dict.fromkeys(name for name, _ in found.seconds))
    figures = [figure(f"{name}, step {step}", "s", values) for (name, step), values in found.seconds.items()]
    of_each = "" if isinstance(drawers, MeasuredCluster) else threads_words(threads_of_each(drawers))
    tables = [timing_table(names, figures, of_each), speed_up_table(names, figures, of_each)]
    if found.taken:
        tables += [cluster_table(found.taken, image), links_table(found.taken)]
    outputs.deliver(record("paper", facts, figures), tables, [panel(names, figures)])


class Found(NamedTuple):
    """What was measured."""

    volume: SurveyedVolume
    shares: Shares
    seconds: Seconds
    taken: Sequence[Taken]  # of a cluster


def measured(subject: Subject, drawers: Drawers, pixels: tuple[int, int], repeats: int) -> Found:
    """Of all rows."""
    seconds, taken, scenes = dict[tuple[str, Step], list[float]](), list[Taken](), list[Scene]()
    seen_shares: Shares | None = None
    with (
        SideConsole().status("starting") as status,
        volume_file(subject, status.update) as path,
        closing(groups_of(drawers, path, None, status.update, like_machines=True)) as groups,
    ):
        for rows in groups:
            status.stop()
            known = rows[0].renderer.volume
            shown, geometry = subject.scene_of(known), known.description.geometry
            scenes = scenes or [seen(shown, geometry, turned, pixels) for turned in around(repeats)]
            seen_shares = seen_shares or shares(rows[0].renderer, scenes[0])
            seconds |= step_seconds(rows, scenes)
            if isinstance(drawers, MeasuredCluster):
                taken += frames_of([row for row in rows if row.workers], [Case("pixels", 1.0, scenes)])
            status.start()
        status.stop()
    assert seen_shares is not None, "there is one row at least"
    return Found(known, seen_shares, seconds, taken)


def step_seconds(rows: Sequence[Row], scenes: Sequence[Scene]) -> Seconds:
    """Of each row and step, over the scenes: the rows take turns, each drawing all six steps of a view."""
    found: dict[tuple[str, Step], list[float]] = {(row.name, step): [] for row in rows for step in PAPER_STEPS}

    def steps_of(row: Row, scene: Scene, keep: bool = True) -> float:
        taken = 0.0
        for step in PAPER_STEPS:
            outcome = row.renderer.finish(scene, step).outcome
            assert outcome is not None
            taken += outcome.wall_seconds
            if keep:
                found[row.name, step].append(outcome.wall_seconds)
        return taken

    for row in rows:
        steps_of(row, scenes[-1], keep=False)  # buffers and tables are made once
    with shown_progress("views", len(scenes)) as step_done:
        by_name = {row.name: (lambda scene, row=row: steps_of(row, scene)) for row in rows}
        interleaved(by_name, scenes, lambda scene: step_done())
    return found


def threads_words(threads: int) -> str:
    """What servers of this machine are, in every row, for a caption that goes on."""
    each = f"{threads} thread{'s' if threads > 1 else ''}"
    return (
        f" Each map/shade server has {each} in every row, as if it were a machine; the splat server may use all cores."
    )


def timing_table(names: Sequence[str], figures: Sequence[Figure], of_each: str) -> TextTable:
    """The paper's rows over this machine's."""
    machine = this_machine()
    table = TextTable(f"Timing tests, seconds; here {machine_words(machine)}", ("", *_headings()), CAPTION + of_each)
    for name, paper_seconds in PAPER_SECONDS.items():
        table.add(f"1989, {name}", *(str(value) for value in paper_seconds))
    table.add()
    for name in names:
        row = [_of(figures, name, step) for step in PAPER_STEPS]
        table.add(name, *(significant(one.median) for one in row))
        table.add("", *(give_or_take(one) for one in row))
    return table


def speed_up_table(names: Sequence[str], figures: Sequence[Figure], of_each: str) -> TextTable:
    """How many times faster several machines were than one, and several servers here."""
    caption = f"Medians over medians. 'over' is: how many times faster than.{of_each}"
    table = TextTable("Speed-ups", ("", *_headings()), caption)
    for above, below in PAPER_SPEED_UPS:
        values = (b / a for a, b in zip(PAPER_SECONDS[above], PAPER_SECONDS[below], strict=True))
        table.add(f"1989, {above} over {below}", *(significant(value) for value in values))
    table.add()
    one, *others = [name for name in names if name != SINGLE]
    for above in (*others, *(name for name in names if name == SINGLE)):
        values = (_of(figures, one, step).median / _of(figures, above, step).median for step in PAPER_STEPS)
        table.add(f"{above} over {one}", *(significant(value) for value in values))
    return table


def panel(names: Sequence[str], figures: Sequence[Figure]) -> Panel:
    lines: dict[str, list[tuple[float | str, float]]] = {
        f"1989, {name}": [(step.value, float(value)) for step, value in zip(PAPER_STEPS, seconds, strict=True)]
        for name, seconds in PAPER_SECONDS.items()
    }
    old = tuple(lines)
    for name in names:
        lines[name] = [(step.value, _of(figures, name, step).median) for step in PAPER_STEPS]
    return Panel("the paper's timing table, and this machine's", "step", "seconds", lines, logarithmic=True, faint=old)


def _headings() -> list[str]:
    return [f"{step}\n{STEP_WORDS[step]}" for step in PAPER_STEPS]


def _of(figures: Sequence[Figure], name: str, step: Step) -> Figure:
    return next(one for one in figures if one.name == f"{name}, step {step}")
