"""The compiled kernels; the C++ files under kernels/ say how they work."""

from collections.abc import Sequence
from typing import Protocol, TypeAlias

from typing_extensions import Buffer

from volsplat.protocol.description.volume import Index
from volsplat.protocol.geometry.matrices import Matrix, Vector

_Axis: TypeAlias = tuple[int, int, int, int, int, bool]  # low, high, stride, first, count, ascending

def constants() -> dict[str, float]:
    """The numbers of the protocol that the module was built with, by name."""

def cpu_paths() -> list[str]:
    """The instruction sets of this machine, narrowest first: baseline, avx2, avx512."""

def cpu_path() -> str:
    """The one in use. Raises BadInput if VOLSPLAT_CPU_PATH names one that cannot be used."""

def set_cpu_path(name: str) -> None:
    """Use another one from now on. Raises BadInput for one that is not in cpu_paths()."""

class Bell:
    """Rung by any thread. Who reads how often before he looks, and then waits for once more, misses nothing."""

    def ring(self) -> None: ...
    @property
    def rung(self) -> int: ...
    def wait(self, heard: int, seconds: float) -> int:
        """Wait until it has been rung more often than was heard, or as long; how often it has been."""

class ReadBudget:
    """Bytes that may be buffered of a sender; `opened` rings when there is room again."""

    def __init__(self, bytes: int, opened: Bell) -> None: ...
    @property
    def open(self) -> bool: ...
    @property
    def held(self) -> int: ...

class BatchMemory:
    """A batch's payload: for each region its row runs (24 bytes each), then its packets (8 bytes each).

    `parts` are their counts; ValueError if they do not fit. The payload may be any contiguous CPU memory. It is pinned
    while this lives or has been pushed and not splatted, and counts in the budget so long.
    """

    def __init__(self, payload: object, parts: Sequence[tuple[int, int]], budget: ReadBudget) -> None: ...

class SlabSeconds:
    """In which slabs were drawn: voxels' kernels added, sums brought to densities, these shaded, slabs laid together.

    The last two take turns too short for a clock: their sum is measured, and what is whose told by some of the tiles.
    """

    @property
    def adding(self) -> float: ...
    @property
    def densities(self) -> float: ...
    @property
    def shading(self) -> float: ...
    @property
    def compositing(self) -> float: ...

class OwnerSeconds:
    """In which an owner merged, splatted (frames of slabs: in `slabs`, and publishing) and walked."""

    @property
    def merge(self) -> float: ...
    @property
    def splat(self) -> float: ...
    @property
    def slabs(self) -> SlabSeconds: ...
    @property
    def walk(self) -> float: ...

class Walked:
    """What walks of this process handed out."""

    @property
    def steps(self) -> int: ...
    @property
    def voxels(self) -> int: ...
    @property
    def packets(self) -> int: ...
    @property
    def bytes(self) -> int: ...

class Walk(Protocol):
    """What an owner may walk."""

    @property
    def source(self) -> object:
        """A capsule: see kernels/batch_source.h. What it points to lives as long as this."""

class SplatFrame:
    """One frame of an image: its regions, and what sources have handed out for them. See splat_frame.h.

    Any thread may call.
    """

    def push(self, source: int, batch: BatchMemory, reached_sheet: int, reached_row: int, last: bool) -> None:
        """Take a batch. Raises ValueError naming the fault, and takes nothing, where it breaks the rules."""

    def finish(self, source: int) -> None:
        """Nothing more will come from the source."""

    def finished(self, source: int) -> bool: ...
    @property
    def complete(self) -> bool:
        """Whether all is splatted. Raises what an owner failed of."""

    @property
    def awaited(self) -> list[int]:
        """The sources without which no region can go on; none if one can."""

    @property
    def packets(self) -> int: ...
    @property
    def hidden_packets(self) -> int:
        """Packets left out as hidden in the region of their first row; another region may still draw them.

        Neighbours that are looked at together count where all of them are hidden: how many are depends on the CPU path.
        """

    def reached(self) -> tuple[int, int]:
        """Sheet and row: all that lies before has been splatted in every region. `news` rings once there is more."""

    @property
    def rectangle(self) -> tuple[int, int, int, int]:
        """Left, top, width and height of what its regions are of the published image."""

    def show(self, target: memoryview) -> None:
        """The rectangle as it stands (see Owners.published), into memory of as many bytes."""

    @property
    def work(self) -> list[int]:
        """Packets whose run's middle lies in each row of tiles of the image. Once it is complete."""

    @property
    def seconds(self) -> list[OwnerSeconds]:
        """Of each owner. Once it is complete."""

    @property
    def spans(self) -> list[list[tuple[str, float, float]]]:
        """Of each owner: a stage of OwnerSeconds, how many seconds ago it began, and ended. Once it is complete."""

    @property
    def walked(self) -> Walked:
        """What its walks have handed out. Once it is complete."""

class BatchTaker:
    """Takes batches out of the channels of a map/shade server of this machine, in a thread of its own.

    See batch_taker.h. Any thread may call.
    """

    def __init__(self, descriptor: int, walkers: int, blocks: int, block_bytes: int, news: Bell) -> None:
        """`news` rings if `take_news` should be called. The descriptor stays open."""
    @staticmethod
    def memory_bytes(walkers: int, blocks: int, block_bytes: int) -> int:
        """What so many channels take."""
    def begin(self, frame: int, into: SplatFrame | None, first_source: int, walkers: int, traced: bool) -> None:
        """From now on push batches of this frame: of sources from `first_source` on, one for each of the `walkers`.

        Those of older frames are of no use any more, and those of later ones wait; without `into` the frame's are of no
        use either.
        """
    def close(self) -> None:
        """Take nothing any more, but for what `drain` does."""
    def drain(self) -> None:
        """Take what is there now."""
    def take_news(self) -> bool:
        """Whether since the last call a fault was found, or a batch came of a later frame than was begun last."""
    @property
    def fault(self) -> str:
        """By which the map/shade server broke the rules; "" if by none."""
    @property
    def newest_frame(self) -> int:
        """That a batch has come of; -1 if none has."""
    @property
    def bytes(self) -> int:
        """Of the frame's batches."""
    @property
    def spans(self) -> list[tuple[int, float, float]]:
        """Which walker's batch was taken when, if the frame is traced: how many seconds ago that began and ended."""

class Owners:
    """Threads that own regions of an image. One thread at a time may call. See owners.h."""

    def __init__(self, threads: int) -> None: ...
    @property
    def threads(self) -> int: ...
    def clear(self, width: int, height: int, turned: bool) -> None:
        """End the frame before, and empty the image, which is of this size as it is published."""

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height of the image that is held; 0 before the first."""

    @property
    def closed_tiles(self) -> memoryview:
        """The image's live map of closed tiles (protocol.closed_tiles): rows x words of uint64, writable."""

    def begin(
        self,
        *,
        regions: Sequence[tuple[int, int]],
        reach: FootprintTable | CellMap | Slabs | None,
        front_to_back: bool,
        frozen_alpha: float = ...,
        thresholds: tuple[int, int],
        counts: tuple[int, int, int],
        sources: int,
        traced: bool = False,
        portion: int,
        edges: tuple[EdgeLayer, EdgeLayer] | None,
        walks: Sequence[Walk],
        block: memoryview | None = None,
        news: Bell,
        all_wait: Bell,
    ) -> SplatFrame:
        """Begin a frame on the image, which must be clear.

        It has `sources` that are pushed, or `walks`, one for each region.

        `block` is memory that its regions are published in as they become complete, as `published` has them; nobody
        else may write to it until then. Raises RuntimeError where a thread cannot be started.
        """

    def published(self, frame: SplatFrame) -> memoryview:
        """The frame's rectangle as it stands, edges included: rows of float32 RGBA, little endian, as bytes.

        The caller's own until it lets go of it; that of a complete frame is always the same.
        """

    def cancel(self) -> None:
        """Splat nothing more of the frame, which stays as it is."""

    def close(self) -> None:
        """End the threads."""

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
    @staticmethod
    def signed(coefficients: Sequence[float], radius: float) -> KernelProjection:
        """(1 - q)^2 times the polynomial of q = (r / radius)^2, the constant coefficient first."""

    def at_square(self, rho_square: float) -> float: ...

class Ellipse:
    def __init__(
        self, amplitude: float, qxx: float, qxy: float, qyy: float, half_width: float, half_height: float
    ) -> None: ...

class FootprintTable:
    """Weights for 2^offset_bits fractional offsets a pixel on each axis."""

    def __init__(self, projection: KernelProjection, ellipse: Ellipse, offset_bits: int, threads: int = 1) -> None: ...
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

class SlabTable:
    """The slices of a kernel on planes parallel to the screen; see slab_table.h."""

    def __init__(
        self,
        kernel: KernelProjection,
        amplitude: float,
        form: Matrix,
        half_extents: Vector,
        offset_bits: int,
        wide: bool,
    ) -> None:
        """Raises ValueError for numbers that make no table. `wide`: for sums of 64 bits."""

    @property
    def pixel_bytes(self) -> int:
        """What the sums of all planes, and the densities of those that are kept, take of one pixel."""

    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...

class SlabScene:
    """What densities are classified and lit by: tables of 256 entries, and what indexes them; see slab_shading.h."""

    def __init__(
        self,
        cross_bar: Sequence[int],
        emit: Sequence[Vector],
        refl: Sequence[Vector],
        opac: Sequence[float],
        modu: Sequence[float],
        light: Vector,
        half_way: Vector,
        switches: tuple[bool, bool, bool],
        specular_power: float,
        dimming: tuple[float, float],
    ) -> None:
        """`switches` are diffuse, specular and two-sided light, `dimming` depth cue and silhouettes."""

class SlabGrid:
    """Where on the grid and in physical space a frame's slabs are; see slab_shading.h."""

    def __init__(
        self,
        gradient: Matrix,
        axes: Sequence[Vector],
        strength: float,
        screen_bytes: Sequence[Sequence[float]],
        dims: Index,
        factors: Index,
    ) -> None: ...

class PassedLight:
    """How much light comes through blocks of a volume to each of them; see passed_light.h."""

    def __init__(self, depths: bytes, unit: float, dims: Index, steps: Sequence[tuple[Vector, float]]) -> None:
        """`depths` of blocks, uint16 in 1 / `unit`; light comes in each step so far in blocks, and for such a length.

        Raises ValueError for numbers that make no light.
        """

    def share(self, i: int, j: int, k: int) -> float:
        """That comes to the middle of a block. Raises IndexError."""

class SlabLight:
    """How a frame of slabs looks up what light comes through; `shares` are shadows and occlusion."""

    def __init__(self, size: Sequence[float], to_blocks: Matrix, shares: tuple[float, float]) -> None: ...

class PatchTable:
    """What patches give by density and strength; see kernels/tables/patch_table.h."""

    def __init__(self, patches: Sequence[Sequence[float]]) -> None:
        """Patches are 14 numbers each: Patch.numbers."""

class Slabs:
    """All that a frame of slabs is drawn by; see regions/slab_planes.h."""

    def __init__(
        self,
        table: SlabTable,
        scene: SlabScene,
        grid: SlabGrid,
        planes: int,
        lead: int,
        baseline: int,
        thickness: float,
        places: Sequence[Vector],
        bounds: tuple[Vector, Vector],
        light: SlabLight,
        lamp: PassedLight | None,
        sky: PassedLight | None,
        plane: PatchTable | None,
    ) -> None:
        """`places` are grid coordinates of pixel (0, 0) on plane 0, and what x, y and planes add to them.

        `plane` takes the place of the scene's tables.
        """

class EdgeLayer:
    """Coverage of anti-aliased white lines, positions in pixels from the centre of the top-left one, y down."""

    def __init__(self, width: int, height: int) -> None: ...
    def draw(self, x0: float, y0: float, x1: float, y1: float, line_width: float) -> None: ...

def largest_code(runs: int, packets: int) -> int:
    """No code of so many runs and packets has more bytes."""

def decode_batch(code: object, counts: Sequence[tuple[int, int]], room: object) -> None:
    """Give parts of so many runs and packets back: of each the runs, then the packets; see batch_code.h.

    Raises ValueError where the code is not one of them. `room` may be any writable contiguous memory.
    """
