"""The compiled kernels; the C++ files under kernels/ say how they work."""

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

def constants() -> dict[str, float]:
    """What the kernels were built with of the protocol's numbers, by name."""

def cpu_path() -> str: ...
def cpu_paths() -> list[str]: ...
def set_cpu_path(name: str) -> None: ...
