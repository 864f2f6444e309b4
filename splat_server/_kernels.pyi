"""The compiled kernels; the C++ files under kernels/ say how they work."""

from collections.abc import Sequence
from typing import TypeAlias

from typing_extensions import Buffer

_Axis: TypeAlias = tuple[int, int, int, int, int, bool]  # low, high, stride, first, count, ascending

def constants() -> dict[str, float]:
    """The numbers of the protocol that the module was built with, by name."""

def cpu_paths() -> list[str]:
    """The instruction sets of this machine, narrowest first: baseline, avx2, avx512."""

def cpu_path() -> str:
    """The one in use. Raises BadInput if VOLSPLAT_CPU_PATH names one that cannot be used."""

def set_cpu_path(name: str) -> None:
    """Use another one from now on. Raises BadInput for one that is not in cpu_paths()."""

class BatchMemory:
    """A batch's row runs (24 bytes each) and packets (8 bytes each), pinned while this lives; ValueError if cut.

    Both may be any contiguous CPU memory: bytes, bytearray, memoryview, or a tensor through DLPack.
    """

    def __init__(self, runs: object, packets: object) -> None: ...
    @property
    def bytes(self) -> int: ...
    @property
    def packet_count(self) -> int: ...
    @property
    def run_count(self) -> int: ...

class SpanList:
    """Spans of runs in merge order; the batches they lie in must live until they are splatted."""

    @property
    def packets(self) -> int: ...
    def entries(self) -> list[tuple[int, int, int, int, int]]:
        """Of each span: batch, first run, run count, first packet, packet count."""

    def __len__(self) -> int: ...

class SortedBuffers:
    """The sorted linked list of the workers' buffers (paper: "Parallel Implementation")."""

    def __init__(self, workers: int, sheets: int, rows: int, samples: int) -> None: ...
    def push(
        self, worker: int, batch: int, memory: BatchMemory, reached_sheet: int, reached_row: int, last: bool
    ) -> None:
        """Append a batch. Raises ValueError naming the fault, and takes nothing, where it breaks the rules."""

    def finish(self, worker: int) -> None: ...
    def advance(self, max_packets: int) -> tuple[SpanList, list[int], int, bool]:
        """Spans of at least `max_packets` if there are so many, released batches, waited for worker or -1, complete."""

    def validate(self) -> None: ...
    @property
    def waits_for(self) -> int: ...
    @property
    def complete(self) -> bool: ...

class LevelTiles:
    """Images of one size, one after the other, by tiles (protocol.image_tiles): 8 bits for each channel of a pixel."""

    def __init__(self, width: int, height: int) -> None: ...
    def note(self, pixels: Buffer, changed: bytearray) -> int:
        """Take the next image; sets the bits of tiles that have changed, and returns how many those are."""

    def planes(self, changed: bytearray, count: int, target: memoryview) -> None:
        """What these tiles are now, as it is compressed."""

class FloatTiles:
    """As LevelTiles, bit for bit."""

    def __init__(self, width: int, height: int) -> None: ...
    def note(self, pixels: Buffer, changed: bytearray) -> int: ...
    def planes(self, changed: bytearray, count: int, target: memoryview) -> None: ...

class KernelProjection:
    """P(rho) of a kernel. `parameter` is sigma for gaussian, alpha for kaiser-bessel, else unused."""

    def __init__(self, kernel: str, parameter: float, radius: float) -> None: ...
    def at_square(self, rho_square: float) -> float: ...

class Ellipse:
    def __init__(
        self, amplitude: float, qxx: float, qxy: float, qyy: float, half_width: float, half_height: float
    ) -> None: ...

class FootprintTable:
    """Weights for 2^offset_bits fractional offsets a pixel on each axis."""

    def __init__(self, projection: KernelProjection, ellipse: Ellipse, offset_bits: int) -> None: ...
    @staticmethod
    def bytes_needed(ellipse: Ellipse, offset_bits: int) -> float: ...
    def weights_at(self, fx: int, fy: int) -> tuple[int, int, list[float]]:
        """Left and top of the box from the sample's pixel, and its height x width weights by rows."""

    @property
    def offset_bits(self) -> int: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def bytes(self) -> int: ...

class CellMap:
    """Grid to screen for cells. `x`, `y`: DDA origin and half steps along the sheet, row and sample axes."""

    def __init__(
        self, x: tuple[int, int, int, int], y: tuple[int, int, int, int], axes: tuple[_Axis, _Axis, _Axis]
    ) -> None: ...

class SplatQueue:
    """Jobs splatted in their order, by threads that share out an image's stripes: see splat_queue.h.

    Raises RuntimeError where a thread cannot be started.
    """

    def __init__(self, image: ImageMemory, threads: int) -> None: ...
    def begin(self, turned: bool, first_line: int, end_line: int) -> None:
        """Drop what is unfinished, and clear the image. What follows mostly reaches these lines of it."""

    def splat(
        self,
        spans: SpanList,
        reach: FootprintTable | CellMap | None,
        front_to_back: bool,
        small: bool,
        batches: object,
    ) -> None:
        """Combine the spans' samples with the image, after all that came before; helps with these while they are much.

        A `small` job is done at once where nothing is unfinished. `batches` holds the spans' memory until it is done.
        """

    def finish(self) -> None:
        """Wait until all is combined."""

    def hand_out(self) -> memoryview:
        """As `finish`; then the image, as `ImageMemory.snapshot`, which is empty afterwards."""

    def cancel(self) -> None:
        """Drop what is unfinished."""

    def close(self) -> None:
        """End the threads, and drop what is unfinished."""

    @property
    def busy(self) -> bool:
        """Whether there is something to combine."""

    @property
    def busy_seconds(self) -> float:
        """For how long there has been something to combine, in all."""

class ImageMemory:
    """float32, associated: see image_memory.h."""

    def __init__(self, width: int, height: int) -> None: ...
    def snapshot(self) -> memoryview:
        """height x width x 4 float32 RGBA, little endian, as bytes; its memory is used again once nobody holds it."""

    @property
    def closed_tiles(self) -> memoryview:
        """The live map of closed tiles (protocol.closed_tiles): rows x words of uint64, writable."""

    @property
    def hidden_packets(self) -> int:
        """Packets left out as hidden, since `clear`, in the stripe of their first row; the next may still draw them."""

class EdgeLayer:
    """Coverage of anti-aliased white lines, positions in pixels from the centre of the top-left one, y down."""

    def __init__(self, width: int, height: int) -> None: ...
    def draw(self, x0: float, y0: float, x1: float, y1: float, line_width: float) -> None: ...

def published(image: ImageMemory, front: EdgeLayer, back: EdgeLayer) -> memoryview:
    """front over (image over back), as `ImageMemory.snapshot`."""

def largest_code(runs: int, packets: int) -> int:
    """No code of so many runs and packets has more bytes."""

def decode_batch(code: object, counts: Sequence[tuple[int, int]], room: object) -> None:
    """Give parts of so many runs and packets back: of each the runs, then the packets; see batch_code.h.

    Raises ValueError where the code is not one of them. `room` may be any writable contiguous memory.
    """
