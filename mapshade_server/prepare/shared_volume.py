"""A volume that many processes read: each opens it by its name, once a run, and makes sure that it is the same one."""

from dataclasses import dataclass
from functools import lru_cache
from threading import Lock

from volsplat.mapshade_server.held.volume_identity import described_volume
from volsplat.mapshade_server.prepare.run_mark import RunMark
from volsplat.mapshade_server.prepare.scalars import Scalars, volume_scalars
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box
from volsplat.protocol.description.volume_identity import VolumeIdentity

_opening = Lock()  # so that threads do not open it side by side


@dataclass(frozen=True)
class SharedVolume:
    """`name` means the same on all machines."""

    name: str
    identity: VolumeIdentity
    mark: RunMark

    def scalars(self) -> Scalars:
        """As this process has opened them. Raises BadInput if it cannot, or finds another volume."""
        with _opening:
            return _opened(self)

    def read(self, box: Box) -> Voxels:
        return self.scalars().values(box)

    def read_second(self, box: Box) -> Voxels:
        """Of a volume that has a second scalar."""
        second = self.scalars().second
        assert second is not None, "the same volume has the same scalars everywhere"
        return second(box)


@lru_cache(maxsize=1)
def _opened(volume: SharedVolume) -> Scalars:
    return volume_scalars(described_volume(volume.name, volume.identity))


def shared_scalars(volume: SharedVolume, opened: Scalars) -> Scalars:
    """What is `opened` here, as any process reads it."""
    second = None if opened.second is None else volume.read_second
    return Scalars(volume.read, second, opened.second_range, opened.chunk)
