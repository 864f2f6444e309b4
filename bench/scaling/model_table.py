"""The model beside what was measured: how far it is off in each setting."""

from collections.abc import Sequence

from volsplat.bench.scaling.model_fit import fitted, load_of, with_servers
from volsplat.bench.scaling.scaling_cases import Case, Taken
from volsplat.bench.tables.text_table import TextTable, significant
from volsplat.client.session.frame_report import StepReport
from volsplat.deploy.frame_model import Cluster, Rates, predicted
from volsplat.deploy.local import shared_out
from volsplat.program.this_machine import usable_cores

NANO = 1e9


def rates_of(taken: Sequence[Taken]) -> tuple[Rates, Rates]:
    """The constants of this machine: of threads, from the frames of one; and of servers, from those of the fewest."""
    alone = {one.case: one for one in taken if not one.row.workers}
    rates = fitted([report for one in alone.values() for report in one.reports])
    counts = [one.row.workers for one in taken if one.row.workers]
    if not counts:
        return rates, rates
    few = [one for one in taken if one.row.workers == min(counts)]
    frames = [(load_of(alone[one.case].usual), cluster_of(one), one.seconds.median) for one in few]
    return rates, with_servers(rates, frames)


def cluster_of(taken: Taken) -> Cluster:
    """What drew it: a single thread, or servers of this machine that share its cores."""
    workers, cores = taken.row.workers, usable_cores()
    if not workers:
        return Cluster(1, 1, 1, 1, cores=1)
    return Cluster(workers, min(shared_out(cores, workers)), 1, cores, cores)


def model_table(taken: Sequence[Taken]) -> TextTable:
    """Milliseconds measured and by the model, and the difference as a share of what was measured."""
    rates, served = rates_of(taken)
    loads: dict[Case, StepReport] = {one.case: one.usual for one in taken if not one.row.workers}
    table = TextTable(
        "Model beside measured",
        ("setting", "by", "measured, ms", "model, ms", "off by", "limit"),
        f"A thread takes {rates.voxel * NANO:.3g} ns a voxel, {rates.packet * NANO:.3g} a packet shaded, "
        f"{rates.splat * NANO:.3g} a packet splatted, {rates.pixel * NANO:.3g} a pixel combined; servers take "
        f"{served.byte * NANO:.3g} ns more a byte, and {served.frame * 1e3:.3g} ms a frame.",
    )
    for one in taken:
        constants, measured = served if one.row.workers else rates, one.seconds.median
        model = predicted(load_of(loads[one.case]), constants, cluster_of(one))
        off = f"{model.seconds / measured - 1:+.0%}"
        cells = (significant(measured * 1e3), significant(model.seconds * 1e3), off, model.limit)
        table.add(one.case.name, one.row.name, *cells)
    return table
