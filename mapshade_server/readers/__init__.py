"""Volume readers: each describes a volume and hands over boxes of its voxels."""

from volsplat.mapshade_server.readers.open_volume import open_volume
from volsplat.mapshade_server.readers.reading.volume_reader import VolumeReader

__all__ = ["VolumeReader", "open_volume"]
