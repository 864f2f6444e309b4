"""The table of phantoms by name."""

import math
from collections.abc import Callable

import torch

from volsplat.client.phantoms.galaxy import make_galaxy
from volsplat.client.phantoms.head import make_head
from volsplat.client.phantoms.known_signals import make_marschner_lobb, make_ramp, make_slab
from volsplat.client.phantoms.p_orbital import make_p_orbital
from volsplat.client.phantoms.protein import make_protein
from volsplat.client.phantoms.rna import make_rna
from volsplat.client.phantoms.seismic import make_seismic
from volsplat.client.phantoms.shells import make_shells
from volsplat.client.phantoms.structure_factors import make_structure_factors
from volsplat.protocol.errors import BadInput
from volsplat.protocol.matrices import Vector
from volsplat.protocol.volume import Geometry, Index

MOST_VOXELS = 1 << 33

Phantom = Callable[[Index | None, Vector | None, int], tuple[torch.Tensor, Geometry]]

PHANTOMS: dict[str, Phantom] = {
    "head": make_head,
    "shells": make_shells,
    "marschner-lobb": make_marschner_lobb,
    "ramp": make_ramp,
    "slab": make_slab,
    "p-orbital": make_p_orbital,
    "rna": make_rna,
    "protein": make_protein,
    "structure-factors": make_structure_factors,
    "galaxy": make_galaxy,
    "seismic": make_seismic,
}


def make_phantom(
    name: str, size: Index | None = None, spacing: Vector | None = None, seed: int = 0
) -> tuple[torch.Tensor, Geometry]:
    """The voxels, shaped (k, j, i), and the place of the phantom `name`, whose middle is the physical origin.

    Physical axes are LPS, the grid's axes along them. Without `size` and `spacing` (mm) each phantom has its own.
    The same arguments give the same bits. Raises BadInput for an unknown name and for a size or spacing that
    cannot be.
    """
    if name not in PHANTOMS:
        raise BadInput(f"phantom {name}: no such phantom; choose one of {', '.join(PHANTOMS)}")
    if size is not None and (min(size) < 1 or math.prod(size) > MOST_VOXELS):
        raise BadInput(f"phantom {name}: a size of {size} cannot be; give 1 or more voxels on each axis, 2^33 at most")
    if spacing is not None and not all(math.isfinite(step) and step > 0 for step in spacing):
        raise BadInput(f"phantom {name}: a spacing of {spacing} cannot be; give three lengths above 0")
    # One thread: slabs are too small to share, on busy cores torch's threads wait for each other many times as long,
    # and how they divide a tensor would show in its last bits.
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        return PHANTOMS[name](size, spacing, seed)
    finally:
        torch.set_num_threads(threads)
