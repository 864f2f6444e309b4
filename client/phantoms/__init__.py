"""Volumes that volsplat makes itself: for the demo, the benchmarks and the tests."""

from volsplat.client.phantoms.make_phantom import PHANTOMS, make_phantom, streamed_phantom
from volsplat.client.phantoms.shells import shells_tables

__all__ = ["PHANTOMS", "make_phantom", "shells_tables", "streamed_phantom"]
