"""The compiled kernels; the C++ files under kernels/ say how they work."""

from collections.abc import Sequence

from typing_extensions import Buffer

class LevelTiles:
    """Images of one size, one after the other, by tiles (protocol.image_tiles): 8 bits for each channel of a pixel."""

    def __init__(self, width: int, height: int) -> None: ...
    def take(self, changed: Buffer, count: int, planes: Buffer) -> None:
        """Take the next image: tiles whose bits are set, of which there are `count`, have these planes."""

    def lay_out(self, pixels: Buffer) -> None:
        """Make `pixels` the image, height x width x 4 float32."""

class FloatTiles:
    """As LevelTiles, bit for bit."""

    def __init__(self, width: int, height: int) -> None: ...
    def take(self, changed: Buffer, count: int, planes: Buffer) -> None: ...
    def lay_out(self, pixels: Buffer) -> None: ...

class PatchTable:
    """What patches of a plane give by density and strength; see kernels/tables/patch_table.h."""

    def __init__(self, patches: Sequence[Sequence[float]]) -> None:
        """Patches are 14 numbers each: Patch.numbers."""
    @property
    def opacity(self) -> Buffer:
        """float64 (65536,), at density | strength << 8."""

    @property
    def emit(self) -> Buffer:
        """float32 (65536, 4): red, green, blue and 0."""

    @property
    def refl(self) -> Buffer: ...
    def clearest(self) -> list[int]:
        """Of each density the strength with the greatest opacity."""

def constants() -> dict[str, float]:
    """What the kernels were built with of the protocol's numbers, by name."""

def cpu_path() -> str: ...
def cpu_paths() -> list[str]: ...
def set_cpu_path(name: str) -> None: ...
