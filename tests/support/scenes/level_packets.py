"""Any packets of a level and of the next coarser one."""

import numpy as np
import torch
from hypothesis import strategies as st
from torch import Tensor

from volsplat.protocol.rules.packet_layout import NO_DATA_BIT

SIZES = st.tuples(st.integers(1, 9), st.integers(1, 9), st.integers(1, 9))
FACTORS = st.tuples(st.integers(1, 2), st.integers(1, 2), st.integers(1, 2))  # voxels of one of the coarser level


def drawn_packets(dims: tuple[int, ...], seed: int, densities: int = 256) -> Tensor:
    """Some without data."""
    random = torch.Generator().manual_seed(seed)
    packets = torch.randint(0, 1 << 31, dims, generator=random)
    packets = packets & ~255 | packets % densities
    return packets | (torch.rand(dims, generator=random) < 0.1).long() << NO_DATA_BIT


def halves(dims: tuple[int, ...], factors: tuple[int, ...] = (2, 2, 2)) -> tuple[int, ...]:
    return tuple(-(-n // factor) for n, factor in zip(dims, factors, strict=True))


def as_packets(packets: Tensor) -> "np.ndarray[tuple[int, ...], np.dtype[np.uint32]]":
    return packets.numpy().astype(np.uint32)
