"""The seismic phantom: a synthetic study of folded and faulted layers, as in colour plate 4.

Each trace is the earth's reflectivity convolved with a Ricker wavelet (Ricker, Geophysics 18 (1953) 10), at vertical
incidence: a boundary between the impedances a and b reflects (b - a) / (b + a) of the amplitude (Sheriff and Geldart,
Exploration Seismology (1995), section 3.2). The convolution is exact: where a boundary crosses the trace, its wavelet
is added. Layers are folded into an anticline and cut by two normal faults of 60 to 75 degrees' dip.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import torch
from torch import Tensor

from volsplat.client.phantoms.centred_grid import Phantom, SheetNoise, placed_grid, sheet_positions
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.geometry.matrices import Vector

SEISMIC_SIZE: Index = (64, 64, 64)
FIELD_OF_VIEW: Vector = (64.0, 64.0, 64.0)  # traces, traces and samples of the default size
SAMPLE_TIME = 0.004  # seconds, two-way, from one of those samples to the next
PEAK_FREQUENCY = 25.0  # Hz, usual for reflections of the upper kilometres

DEEPEST = 80.0  # samples above and below the middle that have layers: faults and folds bring them into view
THINNEST, THICKEST = 4.0, 10.0  # samples
LEAST_IMPEDANCE, GREATEST_IMPEDANCE = 4.0, 9.0  # 10^6 kg/(m^2 s): from shale to limestone

FOLD_HEIGHT, FOLD_LENGTH = 7.0, 80.0  # samples, traces
FOLD_AXIS = math.radians(25.0)  # of the crest's direction, from +y
PLUNGE = 0.06  # samples a trace, of the crest

NOISE = 0.006  # of full reflection


class Fault(NamedTuple):
    """A plane through (at, 0, 0) that leans over by `slope` traces a sample; beyond it, to +x, all is thrown down."""

    at: float
    strike: float  # traces that it moves to +x for each trace to +y
    slope: float
    throw: float  # samples


FAULTS = (Fault(-13.0, 0.18, 0.42, 6.0), Fault(17.0, -0.12, -0.36, -8.0))


def seismic(size: Index | None = None, spacing: Vector | None = None, seed: int = 0) -> Phantom:
    """float32 amplitude, signed: x and y on the ground, which lies at the greatest z; two-way time runs downwards.

    The seed makes other layers.
    """
    geometry, scale = placed_grid(size or SEISMIC_SIZE, spacing, FIELD_OF_VIEW)
    return Phantom(geometry, torch.float32, _recorded(geometry, scale, seed), Kind.SEISMIC)


def _recorded(geometry: Geometry, scale: float, seed: int) -> Iterator[Tensor]:
    boundaries, noise = layer_boundaries(seed), SheetNoise(seed, NOISE)
    for x, y, z in sheet_positions(geometry):
        traces = _traces(x / scale, y / scale, -z / scale, boundaries)
        yield traces + noise.next(*traces.shape)


def ricker(seconds: Tensor) -> Tensor:
    """The wavelet of PEAK_FREQUENCY: 1 in its middle, at 0."""
    squared = (math.pi * PEAK_FREQUENCY * seconds) ** 2
    return (1 - 2 * squared) * torch.exp(-squared)


def layer_boundaries(seed: int) -> list[tuple[float, float]]:
    """Depth in samples from the middle, where nothing is folded, and reflection coefficient, from the top down."""
    generator = torch.Generator().manual_seed(seed)

    def between(low: float, high: float) -> float:
        return low + (high - low) * float(torch.rand((), generator=generator))

    boundaries = []
    depth, above = -DEEPEST, between(LEAST_IMPEDANCE, GREATEST_IMPEDANCE)
    while depth < DEEPEST:
        below = between(LEAST_IMPEDANCE, GREATEST_IMPEDANCE)
        boundaries.append((depth, (below - above) / (below + above)))
        depth, above = depth + between(THINNEST, THICKEST), below
    return boundaries


def _traces(x: Tensor, y: Tensor, t: Tensor, boundaries: list[tuple[float, float]]) -> Tensor:
    """The amplitudes at places in traces and samples from the middle."""
    fold = _fold(x, y)
    values = torch.zeros_like(x + y + t)
    for block, thrown in _blocks():
        for depth, reflection in boundaries:
            crossing = depth + fold + thrown
            here = reflection * _block(x, y, crossing).eq(block)
            values += here * ricker((t - crossing) * SAMPLE_TIME)
    return values


def _fold(x: Tensor, y: Tensor) -> Tensor:
    """How many samples deeper a layer lies at a place than at the crest of the anticline."""
    across = x * math.cos(FOLD_AXIS) + y * math.sin(FOLD_AXIS)
    along = y * math.cos(FOLD_AXIS) - x * math.sin(FOLD_AXIS)
    return FOLD_HEIGHT * (1 - torch.cos(2 * math.pi * across / FOLD_LENGTH)) + PLUNGE * along


def _blocks() -> list[tuple[int, float]]:
    """The blocks between the faults, from -x to +x, with how far each is thrown down."""
    thrown = [0.0]
    for fault in FAULTS:
        thrown.append(thrown[-1] + fault.throw)
    return list(enumerate(thrown))


def _block(x: Tensor, y: Tensor, t: Tensor) -> Tensor:
    """The number of the block at a place: how many faults lie between it and -x."""
    return sum(
        ((x - fault.at - fault.strike * y - fault.slope * t > 0).to(torch.int32) for fault in FAULTS),
        torch.zeros((), dtype=torch.int32),
    )
