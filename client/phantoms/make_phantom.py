"""The table of phantoms by name."""

import math
from collections.abc import Callable, Iterator

import torch

from volsplat.client.phantoms.centred_grid import Phantom
from volsplat.client.phantoms.galaxy import galaxy
from volsplat.client.phantoms.head import head
from volsplat.client.phantoms.known_signals import marschner_lobb, ramp, slab
from volsplat.client.phantoms.p_orbital import p_orbital
from volsplat.client.phantoms.protein import protein
from volsplat.client.phantoms.rna import rna
from volsplat.client.phantoms.seismic import seismic
from volsplat.client.phantoms.shells import shells
from volsplat.client.phantoms.structure_factors import reflections
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.text.errors import BadInput

MOST_VOXELS = 1 << 33
LEAST_STEP = 1e-30  # and one over the greatest

PHANTOMS: dict[str, Callable[[Index | None, Vector | None, int], Phantom]] = {
    "head": head,
    "shells": shells,
    "marschner-lobb": marschner_lobb,
    "ramp": ramp,
    "slab": slab,
    "p-orbital": p_orbital,
    "rna": rna,
    "protein": protein,
    "structure-factors": reflections,
    "galaxy": galaxy,
    "seismic": seismic,
}


def make_phantom(
    name: str, size: Index | None = None, spacing: Vector | None = None, seed: int = 0
) -> tuple[torch.Tensor, Geometry]:
    """The voxels, shaped (k, j, i), and the place of the phantom `name`, whose middle is the physical origin.

    The grid's axes lie along the physical ones. Without `size` and `spacing` (in its unit) each phantom has its own.
    The same arguments give the same bits. Raises BadInput for an unknown name and for a size or spacing that
    cannot be.
    """
    return streamed_phantom(name, size, spacing, seed).whole()


def streamed_phantom(name: str, size: Index | None = None, spacing: Vector | None = None, seed: int = 0) -> Phantom:
    """As `make_phantom`, for one that is larger than the memory. Raises BadInput at once."""
    if name not in PHANTOMS:
        raise BadInput(f"phantom {name}: no such phantom; choose one of {', '.join(PHANTOMS)}")
    if size is not None and (min(size) < 1 or math.prod(size) > MOST_VOXELS):
        raise BadInput(f"phantom {name}: a size of {size} cannot be; give 1 or more voxels on each axis, 2^33 at most")
    if spacing is not None and not all(LEAST_STEP <= step <= 1 / LEAST_STEP for step in spacing):
        lengths = f"{LEAST_STEP:g} to {1 / LEAST_STEP:g}"
        raise BadInput(f"phantom {name}: a spacing of {spacing} cannot be; give three lengths of {lengths}")
    phantom = PHANTOMS[name](size, spacing, seed)
    return phantom._replace(sheets=_by_one_thread(phantom.sheets))


def _by_one_thread(sheets: Iterator[torch.Tensor]) -> Iterator[torch.Tensor]:
    """The sheets, too few to share: on busy cores torch's threads wait for each other many times as long.

    How they divide a tensor would show in its last bits, too.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield from sheets
    finally:
        torch.set_num_threads(threads)
