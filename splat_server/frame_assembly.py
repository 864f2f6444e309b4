"""One frame's way from batches to the published image: the stage that splat server and single process share."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from volsplat.program.frame_spans import FrameSpans, clock
from volsplat.program.peak_memory import peak_memory
from volsplat.program.room_for_image import check_room_for_image, check_room_for_slabs
from volsplat.program.this_machine import this_machine
from volsplat.protocol.description.scene import Order
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.image_messages import RGBA_BYTES
from volsplat.protocol.rules.closed_tiles import TILE_SIDE, tile_map_bytes
from volsplat.protocol.rules.frame_plan import FramePlan
from volsplat.protocol.rules.regions import Region
from volsplat.splat_server import _kernels
from volsplat.splat_server._kernels import Bell, Owners, OwnerSeconds, SplatFrame
from volsplat.splat_server.edge_layers import edge_layers
from volsplat.splat_server.pixel_reach import PixelReach, reach_and_cost
from volsplat.splat_server.slabs import Slabs

# What is splatted between two looks at whether to go on, by whichever is reached first: a few milliseconds.
PACKETS_AT_ONCE = 1 << 17
PIXELS_AT_ONCE = 1 << 23


def packets_at_once(pixels_per_packet: int) -> int:
    return min(PACKETS_AT_ONCE, max(1, PIXELS_AT_ONCE // pixels_per_packet))


class FrameAssembly:
    """A frame of the owners of an image's regions. They do all the work, in threads of their own."""

    def __init__(self, owners: Owners, plan: FramePlan, frame: int, slabs: Slabs | None = None) -> None:
        """Ends the owners' frame before, and empties their image.

        Raises BadInput for a bad plan, and for an image that there is no room for.

        `slabs` are those of a frame of slabs (see slabs_of).
        """
        self.plan = plan
        self.frame = frame
        self._owners = owners
        reach: PixelReach | _kernels.Slabs
        reach, self.pixels_per_packet, self._pixel_bytes = slabs or (*reach_and_cost(plan, owners.threads), 0)
        self._reach = reach
        self._edges = edge_layers(plan.edges, *plan.image_size) if plan.edges else None
        self._begun: SplatFrame | None = None
        self.lines = (0, 0)  # from which to before which its regions reach
        check_room_for_image(*plan.image_size, held=owners.image_size)
        owners.clear(*plan.image_size, plan.turned)

    @property
    def closed_tiles(self) -> memoryview:
        """The live map of closed tiles (protocol.closed_tiles): rows x words of uint64; rises while splatting."""
        return self._owners.closed_tiles

    @property
    def splat(self) -> SplatFrame:
        """What the owners do; it must have begun."""
        assert self._begun is not None
        return self._begun

    def begin(
        self,
        regions: Sequence[Region],
        sources: int,
        news: Bell,
        all_wait: Bell | None = None,
        walks: "Sequence[_kernels.Walk]" = (),
        block: memoryview | None = None,
        traced: bool = False,
    ) -> None:
        """Have the owners splat what so many `sources` push for these regions, or what a walk for each hands out.

        `news` rings once the frame is complete or has failed, or has gone on since it was last asked how far it is;
        `all_wait` when all regions wait for something to be pushed. The image is published in `block`, of
        `published_bytes`, or in memory of its own. `traced`: see `note_owners`.

        Raises BadInput for slabs that there is no room for.
        """
        plan = self.plan
        self.lines = begin, end = regions[0].begin, regions[-1].end
        check_room_for_slabs(plan.width, end - begin, self._pixel_bytes)
        self._begun = self._owners.begin(
            regions=[(region.begin, region.end) for region in regions],
            reach=self._reach,
            front_to_back=plan.order == Order.FRONT_TO_BACK,
            frozen_alpha=plan.frozen_alpha,
            thresholds=plan.thresholds,
            counts=plan.keys,
            sources=sources,
            traced=traced,
            portion=packets_at_once(self.pixels_per_packet),
            edges=self._edges,
            walks=walks,
            block=block,
            news=news,
            all_wait=all_wait or news,
        )

    def abort(self) -> None:
        """Splat nothing more."""
        self._owners.cancel()

    def published_bytes(self, regions: Sequence[Region]) -> int:
        """What the image of these regions takes."""
        return (regions[-1].end - regions[0].begin) * self.plan.width * RGBA_BYTES

    def published(self) -> memoryview:
        """The regions as they stand, edges included: rows of float32 RGBA, little endian, associated alpha."""
        return self._owners.published(self.splat)

    @property
    def rows_of_tiles(self) -> slice:
        """Of the image, those that its regions' lines are in."""
        begin, end = self.lines
        return slice(begin // TILE_SIDE, -(-end // TILE_SIDE))

    @property
    def closed_tiles_of_lines(self) -> bytes:
        """The rows of the map of closed tiles that its lines are in, as they stand."""
        rows, row = self.rows_of_tiles, tile_map_bytes(self.plan.width, TILE_SIDE)
        return bytes(self.closed_tiles.cast("B")[rows.start * row : rows.stop * row])

    @property
    def share_done(self) -> float:
        """About what share of the splatting is done, 0..1.

        Sheets that are passed count, and of those behind them tiles that are closed, where samples are left out.
        """
        (sheet, row), (sheets, rows, _) = self.splat.reached(), self.plan.keys
        passed = min(1.0, (sheet + row / max(1, rows)) / max(1, sheets))
        pixels = (self.lines[1] - self.lines[0]) * self.plan.width
        closed = min(1.0, int.from_bytes(self.closed_tiles_of_lines).bit_count() * TILE_SIDE**2 / max(1, pixels))
        return 1.0 - (1.0 - passed) * (1.0 - closed)

    @property
    def slowest_owner(self) -> OwnerSeconds:
        """That had most to do. Once the frame is complete."""
        return max(self.splat.seconds, key=lambda owner: owner.merge + owner.splat + owner.walk)

    def note_owners(self, spans: FrameSpans, began: float) -> None:
        """Note what each owner was at since the frame `began`, and that else it waited. Once it is complete."""
        if not spans.wanted:
            return
        now = clock()
        for number, owned in enumerate(self.splat.spans):
            row, free = f"owner {number}", began
            for stage, began_ago, ended_ago in owned:
                spans.note(row, "wait", free, max(free, now - began_ago))
                spans.note(row, stage, max(free, now - began_ago), now - ended_ago)
                free = max(free, now - ended_ago)

    def stats(
        self,
        nbytes: int,
        planning_seconds: float,
        frame_seconds: float,
        decoding_seconds: float = 0.0,
        held_back_seconds: Mapping[int, float] = MappingProxyType({}),
    ) -> messages.SplatStats:
        """What the frame cost, of the owners the slowest; with what came for it. Once it is complete."""
        slowest = self.slowest_owner
        return messages.SplatStats(
            packets=self.splat.packets,
            hidden_packets=self.splat.hidden_packets,
            bytes=nbytes,
            frame_seconds=frame_seconds,
            planning_seconds=planning_seconds,
            merge_seconds=slowest.merge,
            splat_seconds=slowest.splat,
            waiting_seconds=max(0.0, frame_seconds - planning_seconds - slowest.merge - slowest.splat),
            held_back_seconds=dict(held_back_seconds),
            decoding_seconds=decoding_seconds,
            work=[packets * self.pixels_per_packet for packets in self.splat.work[self.rows_of_tiles]],
            peak_memory_bytes=peak_memory(),
            machine=this_machine(),
            slabs=None if self.plan.slabs is None else _slab_stages(slowest.slabs),
        )


def _slab_stages(seconds: _kernels.SlabSeconds) -> messages.SlabStages:
    return messages.SlabStages(seconds.adding, seconds.densities, seconds.shading, seconds.compositing)
