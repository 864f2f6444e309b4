"""The parts of one file or folder that can be opened each by itself."""

from volsplat.mapshade_server.readers.open_volume import open_volume
from volsplat.mapshade_server.readers.reading.parts import Part, PartNeeded


def parts_of(name: str) -> list[Part]:
    """Of which one must be named, or may be; none where there is nothing to choose.

    Raises BadInput for what cannot be opened.
    """
    try:
        reader = open_volume(name)
    except PartNeeded as needed:
        return list(needed.parts)
    return list(reader.parts)
