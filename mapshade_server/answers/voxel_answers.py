"""Answers from the voxels that are held: what is seen at a point, a slice, counts, and what dims light."""

from collections.abc import Sequence

from volsplat.mapshade_server.answers.light_depths import summed_depths
from volsplat.mapshade_server.answers.probe import front_most
from volsplat.mapshade_server.answers.slice_parts import slice_parts
from volsplat.mapshade_server.answers.volume_answers import Answer, plane_counts
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.handlers import handlers, takes
from volsplat.protocol.text.errors import BadInput

OfVoxels = messages.ProbeVoxels | messages.ReadSlice | messages.CountPlane | messages.SumDepths


class VoxelAnswers:
    """From the sub-cubes that a request is about (see HeldVolume), which stay what they are, whatever is held next."""

    def __init__(self, sub_cubes: Sequence[SubCube]) -> None:
        self._sub_cubes = sub_cubes

    def answer(self, request: OfVoxels) -> Answer:
        """Raises BadInput for what cannot be made from them."""
        answer: Answer = HANDLERS[type(request)].method(self, request)
        return answer

    @takes(messages.ProbeVoxels)
    def _probe_voxels(self, request: messages.ProbeVoxels) -> Answer:
        voxel = front_most(self._sub_cubes, request.drawing, request.line)
        return Answer(messages.VoxelProbed(request.question, voxel))

    @takes(messages.ReadSlice)
    def _read_slice(self, request: messages.ReadSlice) -> Answer:
        if request.plane.dims != request.drawing.dims:
            raise BadInput(f"slice {request.question} is of another grid than level {request.drawing.level}")
        parts = list(slice_parts(self._sub_cubes, request.drawing, request.plane))
        read = messages.SliceRead(request.question, request.assignment, [part for part, _ in parts])
        return Answer(read, tuple(memoryview(samples) for _, samples in parts))

    @takes(messages.CountPlane)
    def _count_plane(self, request: messages.CountPlane) -> Answer:
        counts = plane_counts(self._sub_cubes)
        return Answer(messages.PlaneCounted(request.question, request.assignment), (counts.cast("B"),))

    @takes(messages.SumDepths)
    def _sum_depths(self, request: messages.SumDepths) -> Answer:
        sums = summed_depths(self._sub_cubes, request.drawing).astype("<u8")
        k, j, i = sums.shape
        return Answer(messages.DepthsSummed(request.frame, request.assignment, (i, j, k)), (sums.data.cast("B"),))


HANDLERS = handlers(VoxelAnswers)
