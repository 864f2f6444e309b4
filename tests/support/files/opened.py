"""What the tests of readers ask of a volume: all of its voxels, its description, or why it is refused."""

import pytest

from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import VolumeDescription
from volsplat.protocol.text.errors import BadInput


def read_whole(name: object) -> Voxels:
    reader = open_volume(str(name))
    return reader.read(reader.description.geometry.box)


def described(name: object) -> VolumeDescription:
    return open_volume(str(name)).description


def refused(name: object) -> str:
    """The one line that refuses to open or to read it."""
    with pytest.raises(BadInput) as refusal:
        read_whole(name)
    assert "\n" not in str(refusal.value)
    return str(refusal.value)
