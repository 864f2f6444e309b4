"""Bare loops that the kernels are measured against."""

from torch import Tensor

def constants() -> dict[str, float]:
    """The numbers of the protocol that the module was built with, by name."""

def cpu_paths() -> list[str]:
    """The instruction sets of this machine, narrowest first: baseline, avx2, avx512."""

def cpu_path() -> str:
    """The one in use. Raises BadInput if VOLSPLAT_CPU_PATH names one that cannot be used."""

def set_cpu_path(name: str) -> None:
    """Use another one from now on. Raises BadInput for one that is not in cpu_paths()."""

class BareSplat:
    """Weighted adds of one `sample` (4,) to boxes of an `image` (H, W, 4), all float32, back to front.

    `corners` (n, 2) int32 are the boxes' top left x, y; `weights` (side, side, 4), sides of 4, 8, 12 or 16 pixels.
    Raises ValueError where a box leaves the image.
    """

    def __init__(self, image: Tensor, corners: Tensor, weights: Tensor, sample: Tensor) -> None: ...
    def run(self) -> None: ...

def bare_shade(packets: Tensor, opacity: Tensor, emit: Tensor, refl: Tensor, light: Tensor, shaded: Tensor) -> int:
    """Look each of `packets` (n,) uint32 up and shade the visible ones into `shaded` (n,) uint64; their number.

    `opacity` (65536,) uint16 by the packet's lower 16 bits, `emit` and `refl` (256, 4) float32 in levels 0..255 by
    density, `light` (32768,) float32 by direction code.
    """
