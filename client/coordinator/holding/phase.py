"""How far the volume is on its way into the servers, which decides what they may say."""

from enum import Enum


class Phase(Enum):
    GATHERING = "not asked for"  # servers are waited for
    DESCRIBING = "being described"
    READING = "being read"  # its sub-cubes
    COUNTING = "being counted"  # its histograms
    SURVEYED = "surveyed"  # scenes can be made, nothing is packed yet
    PACKING = "being packed"
    READY = "packed"
    EMPTY = "to be read again"  # what was asked for last was refused


SETTLED = (Phase.SURVEYED, Phase.READY, Phase.EMPTY)
SURVEYED_PHASES = (*SETTLED, Phase.READING, Phase.PACKING)  # frames of it may be on their way
