"""What is said of the three slices beside a viewport's picture."""

from typing import Annotated

import msgspec

from volsplat.client.slices.volume_slice import VolumeSlice
from volsplat.client.ui.viewport.message_base import Said
from volsplat.client.volume.file_voxel import FileVoxel
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.client.volume.value_certainty import Certainty, density_certainty, strength_certainty
from volsplat.protocol.description.scene import Quantise
from volsplat.protocol.description.volume import Index
from volsplat.protocol.messages.frame_messages import ProbedVoxel
from volsplat.protocol.rules.slice_plane import MOST_SAMPLES

# -- by the page


class SlicesAsked(Said, tag="slices"):
    """The slices through this voxel are wanted from now on, or none any more."""

    at: Index | None
    coloured: bool  # by the tables, or grey
    longest: Annotated[int, msgspec.Meta(ge=1, le=MOST_SAMPLES)]  # samples along a side that the page has room for


class SliceShown(Said, tag="slice_shown"):
    """The slice that came last is on its canvas."""


class VoxelAsked(Said, tag="voxel"):
    """What is the value of this voxel of a slice?"""

    index: Index


# -- by the process


class SliceHeader(msgspec.Struct):
    """What goes before a slice's PNG, in which the earlier of the two other axes runs to the right."""

    slice: int  # the axis that it lies across
    index: int
    step: tuple[int, int]  # voxels for each sample, to the right and down
    missing: bool  # whether a part of it is lost with a server


class VoxelTold(Said, tag="voxel"):
    """What a slice shows of a voxel."""

    index: Index
    found: ProbedVoxel | None
    density_is: Certainty
    strength_is: Certainty


class SliceValueTold(Said, tag="slice_value"):
    """What the file has of a voxel that a slice shows, in all its digits."""

    index: Index
    density: str
    strength: str | None  # None: the file has no second number


def slice_value_told(index: Index, voxel: FileVoxel) -> SliceValueTold:
    density, *second = voxel.digits
    return SliceValueTold(index, density, second[0] if second else None)


def slice_header(part: VolumeSlice, index: int) -> SliceHeader:
    plane, factors = part.plane, part.factors
    across, down = (plane.every * factors[axis] for axis in plane.sides)
    return SliceHeader(plane.axis, index, (across, down), not bool(part.held.all()))


def voxel_told(index: Index, part: VolumeSlice | None, volume: SurveyedVolume, quantise: Quantise) -> VoxelTold:
    """By a slice that goes through it, if one was told."""
    found = part.voxel(index) if part is not None else None
    if part is None or found is None:
        return VoxelTold(index, None, Certainty.EXACT, Certainty.EXACT)
    density = density_certainty(found, volume, quantise)
    if density is Certainty.EXACT and part.plane.every > 1:  # it is a neighbour's
        density = Certainty.ABOUT
    return VoxelTold(index, found, density, strength_certainty(found, volume))
