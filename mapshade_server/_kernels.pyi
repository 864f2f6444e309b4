"""What the compiled kernels offer. Arrays pass without copies by DLPack or the buffer protocol."""

from collections.abc import Callable, Sequence
from typing import Protocol, SupportsInt, type_check_only

from volsplat.protocol.description.volume import Index
from volsplat.protocol.rules.index_rules import DirectionCode

@type_check_only
class Array(Protocol):
    """An array on the CPU: a tensor, a numpy array, a memoryview, or one that a kernel made."""

    def __buffer__(self, flags: int, /) -> memoryview: ...

_Vector = Sequence[float]

def constants() -> dict[str, float]:
    """The numbers of the protocol that the module was built with, by name."""

def cpu_paths() -> list[str]:
    """The instruction sets that this CPU can run, narrowest first: of baseline, avx2 and avx512."""

def cpu_path() -> str:
    """The one in use. Raises BadInput if VOLSPLAT_CPU_PATH names one that cannot be used."""

def set_cpu_path(name: str) -> None:
    """Use another one from now on; the bits stay the same. Raises BadInput for one that is not in cpu_paths()."""

def give_freed_memory_back() -> None:
    """Have the system get memory of 256 KiB and more back as soon as it is freed; for good, where glibc allocates."""

def survey(source: object, low: Index, size: Index, matrix: _Vector) -> tuple[float, float, float, int]:
    """Least and greatest value, greatest |gradient| and voxels without data of a box within a source array.

    `source` is shaped (k, j, i), of any scalar type; `low` and `size` (i, j, k) place the box in it; `matrix` is
    index_rules.physical_gradient, 9 numbers by rows. The first is above the second where no voxel has data.
    """

def histograms(
    source: object,
    low: Index,
    size: Index,
    matrix: _Vector,
    second: object | None,
    density: tuple[float, float],
    strength: tuple[float, float],
    begin: Index,
    block_size: Index,
    block_count: Index,
) -> tuple[Array, Array, Array]:
    """int64 counts of values over the range `density` and of strengths over the range `strength`, 65536 bins each.

    Strength is |gradient|, or what `second` holds, an array of the box alone: (k, j, i), of any scalar type. Then
    float64 (2, bk, bj, bi): least and greatest values of the volume's blocks (block_extremes), in whose grid the box
    begins at `begin`.
    """

def empty_packets(size: Index) -> Array:
    """Room for the voxel packets of a box: uint32 (k, j, i), uninitialised, and behind it what a walk looks at too."""

def pack(
    source: object,
    low: Index,
    size: Index,
    matrix: _Vector,
    second: object | None,
    window_low: float,
    density_scale: float,
    strength_low: float,
    strength_scale: float,
    octahedral: bool,
) -> Array:
    """The voxel packets of a box within a source array: uint32 (k, j, i). `second` as above."""

def power(base: float, exponent: float) -> float:
    """base^exponent for 0 <= base <= 1, the same bits on every machine."""

def direction_vectors(directions: DirectionCode) -> Array:
    """Unit vectors of the direction codes, float64 (32768, 3); zeros for codes without direction."""

def gradient_bytes(directions: DirectionCode, axes: Sequence[_Vector]) -> Array:
    """Bytes of the fields gradient i, j, k: uint8 (3, 32768). `axes` are unit vectors along the grid's axes."""

class RoughLight:
    """What falls on rough directions, of which each stands for several; the same for all views."""

    def __init__(self, roughness: Sequence[_Vector], two_sided: bool, specular_power: float) -> None:
        """`roughness`: for each of the four, cosines of the angles between the mean and directions as likely."""

def light_table(
    directions: DirectionCode,
    light: _Vector,
    half: _Vector,
    diffuse: bool,
    specular: bool,
    two_sided: bool,
    specular_power: float,
    rough: RoughLight | None,
) -> Array:
    """What multiplies the reflected colour, by direction code: float32 (32768,). Rough directions need `rough`."""

def colour_table(colours: Sequence[_Vector]) -> Array:
    """Red, green, blue and 0 of 256 entries: float32 (256, 4)."""

def opacity_table(opac: _Vector, modu: _Vector, exponent: float) -> Array:
    """12-bit codes of 1 - (1 - opac * modu)^exponent at opac index | modu index << 8: uint16 (65536,)."""

class PatchTable:
    """What patches give by density and strength; see kernels/tables/patch_table.h."""

    def __init__(self, patches: Sequence[_Vector]) -> None:
        """Patches are 14 numbers each: Patch.numbers."""
    @property
    def opacity(self) -> Array:
        """float64 (65536,), at density | strength << 8."""

    @property
    def emit(self) -> Array:
        """float32 (65536, 4): red, green, blue and 0."""

    @property
    def refl(self) -> Array: ...
    def seen(self) -> tuple[list[int], list[int]]:
        """The densities, and the strengths, that are not transparent with all of the others."""

class MixtureEntries:
    """What the voxels of a coarser level stand for; see mixtures.h."""

    def __init__(self, keys: Array, counts: Array, left_open: int) -> None:
        """Raises ValueError for what is no mixture."""

    def add(self, other: MixtureEntries) -> None: ...
    @property
    def keys(self) -> Array:
        """Ascending, uint32 (n,): a copy."""

    @property
    def counts(self) -> Array:
        """Of each key, uint64 (n,): a copy."""

    @property
    def left_open(self) -> int:
        """Bits of the finer densities that keys do not tell."""

    def mixed(self, finer: Array) -> Array:
        """The table in bins of the coarser level, from the finer one's: the means over what its voxels stand for."""

def seen_in_columns(
    rows: Array,
    ends: Array,
    axis: int,
    from_high: bool,
    high_first: tuple[bool, bool],
    factors: tuple[int, int, int],
    finer: Array,
    coarser: Array,
) -> tuple[tuple[float, Array, Array], tuple[float, Array, Array]]:
    """What is seen along columns of level_columns, uint32 (n, 9), from one of their ends.

    `ends` tells for each column, or along an axis for each bundle, whose rows come four to a layer, the row after its
    last, int64 (columns,); `axis` is -1 along a diagonal. `high_first` is whether a bundle's upper voxels are nearer
    than its lower ones, on each of the two other axes. `factors` is how many voxels a coarser one stands for along
    i, j, k, 1 or 2.
    Tables are float64 (65536, 6) over density | strength << 8: optical depth of a layer, what is emitted, and what is
    reflected of each of four steps of the light. Of the finer voxels, then of the coarser ones: what they emit, the
    direction codes of those that reflect, int64 (n,), and how much of each step, float64 (n, 4).
    """

def reflected_in_steps(refl: Array, room: Array, step: float) -> Array:
    """See level_light: float64 (n, channels) twice, (n, 4)."""

class ReflectedLight:
    """What a level reflects of a light."""

    def __init__(self, light: Array, step: float) -> None:
        """`light` by direction code, float64 (32768,), is taken in steps of `step`."""

    def add(self, area: float, codes: Array, by_step: Array) -> None:
        """What is seen from one side, of so large an area: int64 (n,), float64 (n, 4)."""

    def amount(self, factor: float) -> float:
        """All that is reflected if there is so many times the light."""

def mixture_of(finer: Array, coarser: Array) -> MixtureEntries:
    """Of packets (k, j, i) of a box, and of the voxels of the next level that are the means of them.

    Raises ValueError unless these are half as many on each axis.
    """

def binned(table: Array) -> Array:
    """The means of a table over density | strength << 8, float64 (65536, channels), over the strengths of each bin:
    float64 (NO_DATA_BIN + 1, channels)."""

def unbinned(table: Array) -> Array:
    """A table in bins over density | strength << 8: float64 (65536, channels)."""

def plane_opacity_codes(opacities: Array, exponent: float) -> Array:
    """12-bit codes of 1 - (1 - opacity)^exponent: uint16 (65536,)."""

class ClassifiedRows:
    """Which voxels of a box's rows can be seen, for each axis that rows were walked along; see classified_rows.h."""

    def __init__(self, size: Index, share: float) -> None:
        """The lists take at most this share of what the packets take."""
    @property
    def bytes(self) -> int:
        """What the lists take."""

    @property
    def axes(self) -> list[int]:
        """The axes of which there are lists."""

class FrameWalk:
    """The walk of some boxes of voxel packets through a frame; see frame_walk.py, which gives it its numbers.

    The packets are those that `pack` made.
    """

    def __init__(
        self,
        boxes: Sequence[tuple[Array, Index, ClassifiedRows]],
        axes: Index,
        ascending: tuple[bool, bool, bool],
        visits: Sequence[tuple[int, int, int, int, int]],
        x: Sequence[SupportsInt],
        y: Sequence[SupportsInt],
        screen_index: Sequence[Sequence[SupportsInt]],
        image: tuple[int, int],
        reach: tuple[float, float],
        thresholds: tuple[int, int],
        cross_bar: Sequence[int],
        emit: Array,
        refl: Array,
        light: Array,
        opacity: Sequence[Array],
        opacity_of_class: Sequence[int],
        visibility: Array,
        gradient_bytes: Array,
        grid_bytes: Sequence[Array],
        closed_tiles: Array | None,
        regions: Sequence[tuple[int, int]],
        walkers: int,
        limits: tuple[int, int],
    ) -> None:
        """`regions` are lines, half open; `limits` are the packets and voxels of a source's batch.

        `walkers` take turns; or, with 0, each region has one of its own, whose batches have one part.
        """

    @property
    def walkers(self) -> int: ...
    def walker(self, number: int) -> Walker:
        """It keeps the walk alive, but its source does not."""

class NeededVoxels:
    """Which voxels of a box of this size frames of slabs take, kept from frame to frame; see needed_voxels.h."""

    def __init__(self, size: Index) -> None:
        """Raises ValueError for a box that is too long."""

class SlabWalk:
    """The walk of some boxes of voxel packets through a frame of slabs; see slab_walk.py."""

    def __init__(
        self,
        boxes: Sequence[tuple[Array, Index, NeededVoxels]],
        axes: Index,
        ascending: tuple[bool, bool, bool],
        visits: Sequence[tuple[int, int, int, int, int]],
        x: Sequence[SupportsInt],
        y: Sequence[SupportsInt],
        depth: Sequence[SupportsInt],
        image: tuple[int, int],
        reach: tuple[float, float],
        groups: tuple[int, int, int],
        dims: Index,
        visible: Array,
        look: tuple[Index, Sequence[Sequence[int]]],
        inner: tuple[Index, Sequence[Sequence[int]]],
        spread: tuple[Index, Sequence[Sequence[int]]],
        overshoot: tuple[float, float],
        closed_tiles: Array | None,
        regions: Sequence[tuple[int, int]],
        walkers: int,
        limits: tuple[int, int],
    ) -> None:
        """`groups` are their count, how many planes before plane 0 they begin, and before a voxel's it may reach.

        `walkers` are as a FrameWalk's.
        """

    @property
    def walkers(self) -> int: ...
    def walker(self, number: int) -> Walker:
        """It keeps the walk alive, but its source does not."""

class Walker:
    """Walks a part of a server's sub-cubes. One thread at a time may have it walk, by `next_batch` or its source."""

    @property
    def source(self) -> object:
        """A capsule: see kernels/batch_source.h."""

    def next_batch(self, max_packets: int, max_voxels: int) -> Batch:
        """What comes next; after the last batch, which there always is, empty ones.

        The limits decide on which row batches end, not what they hold together; a frame's first batches are smaller.
        The memory of a batch is used again once it and its memoryviews are gone.
        """

class Batch:
    """What a walker delivers at once."""

    @property
    def parts(self) -> list[tuple[memoryview, memoryview, int, int]]:
        """Runs, shaded packets and their counts for each region."""

    @property
    def reached(self) -> tuple[int, int]:
        """(sheet, row): all that the walker has before it in traversal order has been delivered."""

    @property
    def last(self) -> bool: ...
    @property
    def voxels_visited(self) -> int:
        """Samples of the step within the bounds, those left out as hidden or outside the image included."""

    @property
    def packet_count(self) -> int: ...

class ChannelMemory:
    """The memory of a link's channels, as the process has it that fills them; see kernels/channels/batch_channels.h."""

    def __init__(self, descriptor: int, walkers: int, blocks: int, block_bytes: int) -> None:
        """The descriptor stays open. Raises OSError or RuntimeError where it cannot be mapped."""
    @staticmethod
    def bytes(walkers: int, blocks: int, block_bytes: int) -> int:
        """What so many channels take."""

class BatchChannel:
    """A walker's end of its channel. One thread at a time may call, but for `close`. Deliveries send through it."""

    def __init__(self, memory: ChannelMemory, walker: int) -> None: ...
    def begin(self, frame: int, batch: Batch, first: int, end: int) -> None:
        """Send the batch's parts from `first` to before `end` next. What was not sent before never will be."""
    def send(self, seconds: float) -> bool:
        """Send as much as there is room for, waiting so many seconds at most for each block. True once all has gone."""
    def close(self) -> None:
        """The splat server is lost, which whoever sends hears. From any thread."""

def span_clock() -> float:
    """Seconds, by the clock of spans: Python's may count from another moment."""

class NewestFrame:
    """Its number, which any thread may set."""

    number: int

class StillWanted:
    """Whether a frame is: while none is newer, and until it is ended."""

    def __init__(self, newest: NewestFrame, frame: int) -> None: ...
    def __call__(self) -> bool: ...
    def end(self) -> None: ...

class ChannelOutlet:
    """A walker's way to a splat server of this machine; see channel_outlet.h."""

    def __init__(
        self, channel: BatchChannel, frame: int, first: int, end: int, tiles: Array | None, wanted: StillWanted
    ) -> None:
        """For the parts from `first` to before `end` of batches. What is closed is noted in `tiles`, uint64 (h, w)."""
    @property
    def bytes(self) -> int: ...
    @property
    def seconds(self) -> float: ...
    @property
    def waiting_seconds(self) -> float:
        """Of these, for the splat server."""
    @property
    def spans(self) -> list[tuple[float, float, float]]:
        """When, by `span_clock`, each batch began to be sent, waited for room, and had gone."""

class Crew:
    """Threads that walk frames together."""

class WalkTally:
    batches: int
    packets: int
    voxels: int
    seconds: float

@type_check_only
class _Outlet(Protocol):
    """What sends a walker's batches in the delivery's place."""

    def most_packets(self) -> float:
        """Of the next batch, at most; may wait."""
    def send(self, batch: Batch, /) -> bool:
        """False if the splat server is lost."""

class Delivery:
    """A frame on its way; see delivery.h."""

    def __init__(
        self,
        walkers: Sequence[Walker],
        outlets: Sequence[Sequence[ChannelOutlet | _Outlet | None]],
        wanted: StillWanted,
    ) -> None:
        """Each walker's outlets, one for each splat server; None where that is lost already. Raises ValueError."""
    def run(self, crew: Crew, on_failure: Callable[[], None]) -> None:
        """Walk and send, once. Raises RuntimeError if a thread cannot be started.

        `on_failure` is called as soon as an outlet or a walker fails, from its thread; others may take longer to end.
        """
    @property
    def failed(self) -> bool: ...
    def check(self) -> None:
        """Raises what the first one failed of, if one has. Once."""
    def tally(self, walker: int) -> WalkTally: ...
    def spans(self, walker: int) -> list[tuple[float, float]]:
        """When, by `span_clock`, each of its batches was begun, and walked."""
    def lost(self, server: int) -> bool: ...

class BatchEncoder:
    """Writes batches of one frame without what follows from its lattice; see batch_code.h."""

    def __init__(self, lattice: Sequence[int]) -> None:
        """As sample_lattice has it."""
    def encode(self, parts: Sequence[tuple[Array, Array]]) -> memoryview:
        """The code of parts, each with its runs and packets; valid until the next call.

        Raises ValueError where they are not on the lattice.
        """

class SignsOfLife:
    """Bytes that a thread of its own sends over a socket, though a library holds the interpreter."""

    def __init__(self, socket: int, signs: Sequence[bytes], seconds: float) -> None:
        """The first after so many seconds. Raises RuntimeError if the system has no descriptor or thread left."""

    @property
    def left(self) -> int:
        """How many have not been sent."""

    def take_back(self) -> bytes:
        """Send no more. What was not sent, in order; it may begin amid a sign."""
