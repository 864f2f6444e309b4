"""Preprocessing to voxel packets in plain float64 torch (paper: "Shading"; rules: protocol.index_rules)."""

import functools
import math

import torch
from torch import Tensor

from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.rules.index_rules import (
    DIRECTION_CODES,
    FIRST_TWO_FACED,
    OCTAHEDRAL_NO_GRADIENT,
    OCTAHEDRAL_SIDE,
    PAPER_NO_GRADIENT,
    ROUGH_DIRECTIONS,
    ROUGH_SIDE,
    TWO_FACED_DIRECTIONS,
    TWO_FACED_SIDE,
    Quantisation,
    physical_gradient,
)
from volsplat.protocol.rules.packet_layout import DIRECTION_SHIFT, NO_DATA_BIT


def with_no_data_as_nan(values: Tensor) -> Tensor:
    """float64 values (k, j, i) with infinite values counted as no data, like NaN."""
    values = values.to(torch.float64)
    return torch.where(torch.isfinite(values), values, torch.nan)


def gradients(values: Tensor, geometry: Geometry) -> Tensor:
    """The gradient per unit of physical length, float64 (k, j, i, 3) with components along the physical axes.

    Central differences by two steps; one-sided by one step if a neighbour is outside or no data; 0 if both are.
    """
    values = with_no_data_as_nan(values)
    per_step = torch.stack([_difference(values, dim) for dim in (2, 1, 0)], dim=-1)
    m = physical_gradient(geometry)
    components = [
        m[a][0] * per_step[..., 0] + m[a][1] * per_step[..., 1] + m[a][2] * per_step[..., 2] for a in range(3)
    ]
    return torch.stack(components, dim=-1)


def _difference(values: Tensor, dim: int) -> Tensor:
    missing = torch.full_like(values.narrow(dim, 0, 1), torch.nan)
    size = values.shape[dim]
    after = torch.cat([values.narrow(dim, 1, size - 1), missing], dim)
    before = torch.cat([missing, values.narrow(dim, 0, size - 1)], dim)
    has_after, has_before = ~torch.isnan(after), ~torch.isnan(before)
    central = (after - before) * 0.5
    forward, backward = after - values, values - before
    one_sided = torch.where(has_after, forward, torch.where(has_before, backward, 0.0))
    return torch.where(has_after & has_before, central, one_sided)


def strengths(gradient: Tensor) -> Tensor:
    """|gradient| of (…, 3); 0 if it is not finite."""
    x, y, z = gradient.unbind(-1)
    size = torch.sqrt(x * x + y * y + z * z)
    return torch.where(torch.isfinite(size), size, 0.0)


def octahedral_codes(gradient: Tensor, side: int = OCTAHEDRAL_SIDE) -> Tensor:
    """int64 direction codes of gradients (…, 3), which must not be zero."""
    middle = side // 2
    p = gradient / gradient.abs().sum(-1, keepdim=True)
    x, y, z = p.unbind(-1)
    fold = z < 0
    folded_x = torch.where(fold, (1 - y.abs()) * _sign(x), x)
    folded_y = torch.where(fold, (1 - x.abs()) * _sign(y), y)
    u = torch.floor((folded_x + 1) * middle + 0.5)
    v = torch.floor((folded_y + 1) * middle + 0.5)
    return (side * v + u).to(torch.int64)


def paper_codes(gradient: Tensor) -> Tensor:
    """int64 direction codes of 5 + 5 + 5 bits of gradients (…, 3), which must not be zero."""
    c = gradient / gradient.abs().amax(-1, keepdim=True) * 15
    rounded = (torch.floor(c.abs() + 0.5) * _sign(c)).to(torch.int64) + 16
    return rounded[..., 0] | rounded[..., 1] << 5 | rounded[..., 2] << 10


def _sign(x: Tensor) -> Tensor:
    return torch.where(x < 0, -1.0, 1.0).to(torch.float64)


def pack(values: Tensor, geometry: Geometry, quantisation: Quantisation, second: Tensor | None = None) -> Tensor:
    """The voxel packets of a whole volume: int64 (k, j, i) from float64 values (k, j, i), NaN where there are none.

    `second`, of the same shape, is the second scalar that takes the place of the gradient's strength.
    """
    values = with_no_data_as_nan(values)
    gradient = gradients(values, geometry)
    size = strengths(gradient)
    lit = size > 0
    window_low = quantisation.window[0]
    density = torch.floor(((values - window_low) * quantisation.density_scale).clamp(0, 255) + 0.5)
    told = size if second is None else with_no_data_as_nan(second)
    level = (told - quantisation.strength_low) * quantisation.strength_scale
    strength = torch.floor(level.nan_to_num(nan=0.0).clamp(0, 255) + 0.5)
    octahedral = quantisation.directions == "octahedral"
    coded = (octahedral_codes if octahedral else paper_codes)(torch.where(lit[..., None], gradient, 1.0))
    code = torch.where(lit, coded, OCTAHEDRAL_NO_GRADIENT if octahedral else PAPER_NO_GRADIENT)
    no_data = torch.isnan(values)
    packets = density.nan_to_num().to(torch.int64) | strength.to(torch.int64) << 8 | code << DIRECTION_SHIFT
    return torch.where(no_data, 1 << NO_DATA_BIT, packets)


@functools.cache
def directions(scheme: str) -> Tensor:
    """The unit vectors of all direction codes, float64 (32768, 3), physical axes; zeros for codes without direction."""
    code = torch.arange(DIRECTION_CODES)
    if scheme == "octahedral":
        d = torch.where((code < OCTAHEDRAL_NO_GRADIENT)[:, None], _octahedral(code, OCTAHEDRAL_SIDE), 0.0)
    elif scheme == "rough":
        d = torch.zeros((DIRECTION_CODES, 3), dtype=torch.float64)
        d[:FIRST_TWO_FACED] = _octahedral(code[:FIRST_TWO_FACED] % ROUGH_DIRECTIONS, ROUGH_SIDE)
        d[FIRST_TWO_FACED : FIRST_TWO_FACED + TWO_FACED_DIRECTIONS] = _octahedral(
            code[:TWO_FACED_DIRECTIONS], TWO_FACED_SIDE
        )
    else:
        d = torch.stack([(code >> shift & 31) - 16 for shift in (0, 5, 10)], dim=-1).to(torch.float64)
    # torch's own square root may be off in the last bit
    size = torch.tensor([[math.sqrt(square)] for square in d.square().sum(-1).tolist()], dtype=torch.float64)
    return torch.where(size > 0, d / torch.where(size > 0, size, 1.0), 0.0)


def _octahedral(code: Tensor, side: int) -> Tensor:
    """The directions of codes (n,), not normalised: float64 (n, 3)."""
    middle = side // 2
    x, y = (code % side - middle).to(torch.float64), (code // side - middle).to(torch.float64)
    z = middle - x.abs() - y.abs()
    fold = z < 0
    folded_x = torch.where(fold, (middle - y.abs()) * _sign(x), x)
    folded_y = torch.where(fold, (middle - x.abs()) * _sign(y), y)
    return torch.stack([folded_x, folded_y, z], dim=-1)


def gradient_field_bytes(scheme: str, geometry: Geometry) -> Tensor:
    """The bytes of the fields gradient i, j, k for all direction codes, int64 (3, 32768)."""
    d = directions(scheme)
    rows = []
    for axis in range(3):
        along = matrices.normalised(matrices.column(geometry.index_to_physical, axis))
        c = d[:, 0] * along[0] + d[:, 1] * along[1] + d[:, 2] * along[2]
        rows.append(torch.floor(128.5 + 127 * c).to(torch.int64))
    return torch.stack(rows)
