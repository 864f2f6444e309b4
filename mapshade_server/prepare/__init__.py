"""`volsplat prepare`: turns a volume of any size into a packet store, within bounded memory.

Two passes over the source. The first surveys it (survey.py): extremes, then histograms, from which the window and the
strength scale follow by the very rules of a session. The second packs it, one block at a time (level_packing.py); a
block is a row of whole shards with one voxel of halo, so that what is held depends on --memory alone, not on the
volume (layout.py). The same block's means (halving.py) go to a raw file beside the store, from which the next level is
packed in the same way: an eighth of the voxels on disk (of thick slices a quarter), instead of sheets carried in memory
that grow with the volume's width. A source that is compressed as a whole is unpacked once, into such a raw file too
(level_source.py), since three readings by blocks would unpack it from its beginning again and again; so is what comes
from a URL.

It is a room of the map/shade server, top floor: it reads, surveys and packs by the server's own modules, and none of
them knows it. It starts nothing and talks to nobody.

What is finished stands in a journal (journal.py). Killed at any moment, the same command goes on from there, and ends
with the same bytes as if nothing had happened.
"""

from volsplat.mapshade_server.prepare.prepare import Options, Prepared, prepare
from volsplat.mapshade_server.prepare.progress import Progress

__all__ = ["Options", "Prepared", "Progress", "prepare"]
