"""What clusters larger than this machine would take, by the model of a frame's time."""

from collections.abc import Sequence
from dataclasses import replace

from volsplat.bench.scaling.model_fit import load_of
from volsplat.bench.scaling.model_table import rates_of
from volsplat.bench.scaling.scaling_cases import Taken
from volsplat.bench.tables.text_table import TextTable, significant
from volsplat.deploy.frame_model import PIXEL_BYTES, Cluster, Load, Prediction, Rates, predicted
from volsplat.program.this_machine import usable_cores

LINKS = {"1 Gbit/s": 1e9, "10 Gbit/s": 1e10}


def predictions_table(taken: Sequence[Taken], workers: Sequence[int]) -> TextTable:
    """What so many map/shade servers would take, and how many splat servers are best, each on a machine like this."""
    _, served = rates_of(taken)
    cores = usable_cores()
    table = TextTable(
        "Predicted by the model",
        ("setting", "map/shade servers", "links", "splat servers", "ms", "images/s", "limit"),
        f"Each server has a machine like this one, of {cores} threads; images travel with 8 bits a channel.",
    )
    for one in (one for one in taken if not one.row.workers and one.case.group == "pixels"):
        load = replace(load_of(one.usual), image_bytes=PIXEL_BYTES * one.case.value * 1e6)
        for count in workers:
            for link, rate in LINKS.items():
                splats, model = _best(load, served, Cluster(count, cores, 1, cores, cores, rate))
                cells = (str(count), link, str(splats), significant(model.seconds * 1e3))
                table.add(one.case.name, *cells, significant(1 / model.seconds), model.limit)
    return table


def _best(load: Load, rates: Rates, cluster: Cluster) -> tuple[int, Prediction]:
    """The number of splat servers, up to that of map/shade servers, that takes least, and what it takes."""
    counts = [2**n for n in range(cluster.workers.bit_length())]
    models = {count: predicted(load, rates, replace(cluster, splat_servers=count)) for count in counts}
    best = min(models, key=lambda count: models[count].seconds)
    return best, models[best]
