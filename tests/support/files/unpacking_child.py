"""Opens and reads volumes one after the other, prints in a line what each ends in, and last this process's peak memory.

A line for each argument, then how many MiB were resident at most, before and after.
"""

import sys

from volsplat.mapshade_server.readers import open_volume
from volsplat.program.peak_memory import peak_memory
from volsplat.protocol.text.errors import BadInput


def outcome(volume: str) -> str:
    try:
        reader = open_volume(volume)
        reader.read(reader.description.geometry.box)
    except BadInput as refusal:
        return f"refused: {refusal}"
    return "read"


def main() -> None:
    for module in ("zarr", "h5py", "tifffile", "astropy.io.fits", "SimpleITK"):
        __import__(module)
    before = peak_memory()
    for volume in sys.argv[1:]:
        print(outcome(volume))
    print(before >> 20, peak_memory() >> 20)


if __name__ == "__main__":
    main()
