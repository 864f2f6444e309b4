"""What a map/shade server holds of the volume: its sub-cubes, and while others get theirs from it, all of it.

Takes the client's requests about the volume and gives the answers; knows no connection.
"""

import time
from array import array

from volsplat.mapshade_server.awaited_parts import AwaitedParts
from volsplat.mapshade_server.lent_volume import LentVolume, lent
from volsplat.mapshade_server.readers import VolumeReader, open_volume
from volsplat.mapshade_server.sub_cube import SubCube
from volsplat.protocol import messages
from volsplat.protocol.errors import BadInput
from volsplat.protocol.index_rules import HISTOGRAM_BINS


class HeldVolume:
    """The sub-cubes of one assignment, and how they come here. Every method raises BadInput where it cannot be done."""

    def __init__(self) -> None:
        self.sub_cubes: list[SubCube] = []
        self.assignment = 0
        self._lent: LentVolume | None = None
        self._lent_for = 0  # assignment
        self._awaited: AwaitedParts | None = None

    def check(self, assignment: int, what: str) -> None:
        """Whether `what` can be made from what is held."""
        if assignment != self.assignment:
            raise BadInput(f"{what} is for assignment {assignment}, not {self.assignment}")

    def describe(self, request: messages.DescribeVolume) -> messages.VolumeDescribed:
        return messages.VolumeDescribed(description=open_volume(request.path).describe())

    def read(self, request: messages.ReadSubCubes) -> messages.SubCubesRead:
        """From the volume that was lent to others, if it is that, which is let go; else from the file."""
        started = time.perf_counter()
        loan = self._lent if self._lent_for == request.assignment else None
        self._drop()  # nothing is held, should the reading fail
        reader: VolumeReader = loan or open_volume(request.path)
        description = reader.describe()
        sub_cubes = [SubCube(description.geometry, box, description.second_scalar) for box in request.boxes]
        for sub_cube in sub_cubes:
            sub_cube.read(reader)
        return self._hold(sub_cubes, request.assignment, started)

    def lend(self, request: messages.LendVolume) -> messages.VolumeLent:
        started = time.perf_counter()
        self._drop()
        self._lent, self._lent_for = lent(open_volume(request.path)), request.assignment
        return messages.VolumeLent(
            assignment=request.assignment,
            scalar_types=self._lent.scalar_types,
            bytes=self._lent.nbytes,
            seconds=time.perf_counter() - started,
        )

    def part(self, request: messages.ReadPart) -> memoryview:
        """The values of a part of the lent volume."""
        if self._lent is None or self._lent_for != request.assignment:
            raise BadInput(f"a part is for assignment {request.assignment}, of which nothing is lent")
        return self._lent.part(request.part)

    def wait_for_parts(self, request: messages.AwaitParts) -> None:
        """Hold the boxes once their last part has come."""
        self._drop()
        self._awaited = AwaitedParts(request)

    def take(self, request: messages.HoldPart, values: memoryview) -> messages.SubCubesRead | None:
        """Keep a part; the answer of all where it was the last."""
        awaited = self._awaited
        if awaited is None or awaited.assignment != request.assignment:
            raise BadInput(f"a part is for assignment {request.assignment}, of which nothing is awaited")
        awaited.take(request.part, values)
        if not awaited.complete:
            return None
        self._awaited = None
        return self._hold(awaited.sub_cubes(), awaited.assignment, awaited.began)

    def count(self, request: messages.CountHistograms) -> tuple[memoryview, memoryview]:
        """Density and strength, HISTOGRAM_BINS int64 each."""
        density, strength = array("q", bytes(8 * HISTOGRAM_BINS)), array("q", bytes(8 * HISTOGRAM_BINS))
        for sub_cube in self.sub_cubes:
            more = sub_cube.histograms(request.low, request.high, request.max_gradient)
            density = array("q", map(int.__add__, density, more[0]))
            strength = array("q", map(int.__add__, strength, more[1]))
        return memoryview(density).cast("B"), memoryview(strength).cast("B")

    def pack(self, request: messages.PackVoxels) -> messages.VoxelsPacked:
        started = time.perf_counter()
        for sub_cube in self.sub_cubes:
            sub_cube.pack(request.quantisation)
        voxels = sum(sub_cube.box.voxels for sub_cube in self.sub_cubes)
        return messages.VoxelsPacked(
            assignment=request.assignment,
            voxels=voxels,
            bytes=4 * voxels,
            seconds=time.perf_counter() - started,
        )

    def _drop(self) -> None:
        self.sub_cubes, self.assignment = [], 0
        self._lent, self._awaited = None, None

    def _hold(self, sub_cubes: list[SubCube], assignment: int, started: float) -> messages.SubCubesRead:
        survey = sub_cubes[0].survey()
        for sub_cube in sub_cubes[1:]:
            survey = survey.joined(sub_cube.survey())
        self.sub_cubes, self.assignment = sub_cubes, assignment
        return messages.SubCubesRead(
            assignment=assignment,
            survey=survey,
            bytes=sum(sub_cube.source_bytes for sub_cube in sub_cubes),
            seconds=time.perf_counter() - started,
        )
