"""How many images a second a cluster will draw of a volume, by the model of docs/how_it_works/performance.md."""

from collections.abc import Sequence
from typing import NamedTuple

from volsplat.deploy.doctor.finding import Finding
from volsplat.deploy.frame_model import PIXEL_BYTES, Cluster, Load, Prediction, Rates, predicted
from volsplat.deploy.server_command import Program
from volsplat.program.this_machine import usable_cores
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.rules.levels import finest_needed
from volsplat.protocol.rules.resolved_view import FIT_FRACTION, zoom_showing_all

# docs/how_it_works/performance.md: the model
RATES = Rates(voxel=0.1e-9, packet=10e-9, splat=4e-9, pixel=0.4e-9, frame=5e-3)
SHARES = {"a tenth": 0.1, "a hundredth": 0.01}  # of the voxels that show: nested shells, a thin surface
FOOTPRINT_SIDE = 4.0  # voxels, and pixels at least


class Drawer(NamedTuple):
    """A server: `bits_per_second` of its link to the client, None within one machine."""

    program: Program
    threads: int
    bits_per_second: float | None


class Size(NamedTuple):
    """Of an image, in pixels."""

    width: int
    height: int


def forecast(name: str, drawers: Sequence[Drawer], geometry: Geometry, size: Size) -> Finding:
    """Of step F, with the whole volume in the image."""
    cluster = cluster_of(drawers)
    models = {words: predicted(load_of(geometry, size, share), RATES, cluster) for words, share in SHARES.items()}
    told = "; ".join(f"{_rate(model)} if {words} of the voxels shows" for words, model in models.items())
    limit = next(iter(models.values())).limit
    line = f"{size.width} x {size.height}: {told}; limited by {limit}, by a model of quiet machines"
    return Finding(name, "forecast", right=True, line=line)


def drawn_level(levels: Sequence[Geometry], size: Size) -> Geometry:
    """Of a volume's levels, finest first, the one that its fit into an image takes."""
    return levels[finest_needed(levels, zoom_showing_all(levels[0], *size))]


def cluster_of(drawers: Sequence[Drawer]) -> Cluster:
    """As the model knows it: servers are alike, and the slowest link counts."""
    workers = [one.threads for one in drawers if one.program is Program.MAPSHADE_SERVER]
    splats = [one.threads for one in drawers if one.program is Program.SPLAT_SERVER]
    links = [one.bits_per_second for one in drawers if one.bits_per_second is not None]
    return Cluster(
        workers=len(workers),
        walkers=max(1, sum(workers) // len(workers)),
        splat_servers=len(splats),
        owners=max(1, sum(splats) // len(splats)),
        cores=usable_cores(),
        bits_per_second=min(links, default=None),
    )


def load_of(geometry: Geometry, size: Size, share: float) -> Load:
    """If this share of the voxels shows."""
    voxels = float(geometry.box.voxels)
    footprint = FOOTPRINT_SIDE * max(zoom_showing_all(geometry, *size), 1.0)
    packets = voxels * share
    return Load(
        voxels=voxels,
        packets=packets,
        pixels=packets * footprint**2,
        footprint_lines=footprint,
        lines=FIT_FRACTION * min(size),
        image_bytes=size.width * size.height * PIXEL_BYTES,
    )


def _rate(model: Prediction) -> str:
    return f"{float(f'{1 / model.seconds:.2g}'):g} images a second"
