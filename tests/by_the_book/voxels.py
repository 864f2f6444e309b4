"""Section 2 of docs/how_it_works/image.md: voxels become 32 bits, and directions come back from them."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Codes = NDArray[np.int64]


def packed(
    values: Array, to_physical: Array, window: tuple[float, float], strength_scale: float, octahedral: bool
) -> Codes:
    """The 32 bits of voxels (k, j, i)."""
    v = np.where(np.isfinite(values), values, np.nan)
    low, high = window
    with np.errstate(invalid="ignore"):
        density = np.floor(np.clip((v - low) * (255 / (high - low)), 0, 255) + 0.5)
    steps = np.stack([_differences(v, axis) for axis in (2, 1, 0)], axis=-1)
    gradient = steps @ np.linalg.inv(to_physical)
    size = np.sqrt((gradient**2).sum(axis=-1))
    size = np.where(np.isfinite(size), size, 0)
    strength = np.floor(np.clip(size * strength_scale, 0, 255) + 0.5)
    code = _direction_codes(np.where((size > 0)[..., None], gradient, 1.0), octahedral)
    none = 32761 if octahedral else 16 + (16 << 5) + (16 << 10)
    code = np.where(size > 0, code, none)
    packed = np.nan_to_num(density).astype(np.int64) + strength.astype(np.int64) * 256 + code * 65536
    return np.where(np.isnan(v), 1 << 31, packed)


def _differences(v: Array, axis: int) -> Array:
    ahead, back = np.full_like(v, np.nan), np.full_like(v, np.nan)
    ahead = np.moveaxis(ahead, axis, 0)
    back = np.moveaxis(back, axis, 0)
    along = np.moveaxis(v, axis, 0)
    ahead[:-1], back[1:] = along[1:], along[:-1]
    central = (ahead - back) / 2
    found = np.where(np.isnan(central), np.where(np.isnan(ahead), along - back, ahead - along), central)
    found = np.where(np.isnan(ahead) & np.isnan(back), 0, found)
    return np.moveaxis(found, 0, axis)


def _sign(x: Array) -> Array:
    return np.where(x < 0, -1.0, 1.0)


def _direction_codes(g: Array, octahedral: bool) -> Codes:
    if not octahedral:
        c = g / abs(g).max(axis=-1, keepdims=True) * 15
        parts = (np.floor(abs(c) + 0.5) * _sign(c)).astype(np.int64) + 16
        whole: Codes = parts[..., 0] + (parts[..., 1] << 5) + (parts[..., 2] << 10)
        return whole
    x, y, z = np.moveaxis(g / abs(g).sum(axis=-1, keepdims=True), -1, 0)
    x, y = np.where(z < 0, (1 - abs(y)) * _sign(x), x), np.where(z < 0, (1 - abs(x)) * _sign(y), y)
    codes: Codes = (181 * np.floor((y + 1) * 90 + 0.5) + np.floor((x + 1) * 90 + 0.5)).astype(np.int64)
    return codes


def directions(octahedral: bool) -> Array:
    """The unit vector of each code, or zeros: (32768, 3)."""
    code = np.arange(32768)
    if octahedral:
        x, y = (code % 181 - 90).astype(np.float64), (code // 181 - 90).astype(np.float64)
        z = 90 - abs(x) - abs(y)
        x, y = np.where(z < 0, (90 - abs(y)) * _sign(x), x), np.where(z < 0, (90 - abs(x)) * _sign(y), y)
        vectors = np.stack([x, y, z], axis=1) * (code < 32761)[:, None]
    else:
        vectors = np.stack([(code >> shift & 31) - 16.0 for shift in (0, 5, 10)], axis=1)
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 0, vectors / np.where(length > 0, length, 1), 0)
