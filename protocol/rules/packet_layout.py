"""The bits of a voxel packet, a shaded packet and a row run. Kernels and reference follow these numbers.

Voxel packet (32 bits, paper: "Shading"):

    bits  0.. 7  density
    bits  8..15  gradient strength, or a second scalar that the volume has
    bits 16..30  direction code (see index_rules)
    bit  31      no data: never drawn

Shaded packet (64 bits, little endian):

    bits  0..13  x, in 1/64 pixel from its run's origin, 0..16383
    bits 14..27  y, likewise, downwards
    bits 28..39  opacity code, never 0 on the wire
    bits 40..47  red      bits 48..55  green      bits 56..63  blue

In frames of slabs (see slab_shape) a packet is a voxel's, with these bits in place of opacity and colour:

    bits 28..39  depth, in 1/8 plane from that of its group's first plane
    bits 40..47  density

Voxels are grouped by the first plane that their kernels may reach, GROUP_PLANES at a time.

Row run (24 bytes, little endian): sheet, row, first sample and count as uint32, then x and y of the origin as
int32 in 1/64 pixel. Sheet, row and sample are ordinals in traversal order, so that the key (sheet, row, first)
rises through a frame. All packets of a run lie in one sheet and row; the first has ordinal `first`. In frames of slabs
groups of planes take the place of sheets. A group's rows are counted some BLOCK_ROWS neighbours at a time, through all
sheets, so that what they reach on the screen stays near: row r of sheet s has the number
(r // BLOCK_ROWS * sheets + s) * BLOCK_ROWS + r % BLOCK_ROWS.
"""

import struct

NO_DATA_BIT = 31
DIRECTION_SHIFT = 16

SUBPIXEL_BITS = 6  # positions are multiples of 1/64 pixel
POSITION_BITS = 14  # 256 pixels
OPACITY_SHIFT = 28
COLOUR_SHIFT = 40

DEPTH_SHIFT = 28
DENSITY_SHIFT = 40
DEPTH_BITS = 3  # depths are multiples of 1/8 plane
GROUP_PLANES = 8
BLOCK_ROWS = 16

VOXEL_PACKET_BYTES = 4
SHADED_PACKET_BYTES = 8
ROW_RUN_BYTES = 24
ROW_RUN = struct.Struct("<IIIIii")

# The opacity code is a float of 4 exponent and 8 mantissa bits with gradual underflow; code 4095 is exactly 1.
OPACITY_CODES = 4096
OPACITY_UNIT = 511 * 2**14

# What a voxel of a coarser level stands for is told by bins: those of one density byte whose strength bytes are alike,
# the first four bins as wide as a byte and then four to each doubling. A bin's number is density | strength's bin << 8.
EXACT_STRENGTHS = 4
STRENGTH_BINS = 28
NO_DATA_BIN = 256 * STRENGTH_BINS
BIN_BITS = 13
# So many entries are kept of a mixture, that memory is bounded: noise has as many as it has voxels.
MOST_MIXTURE_ENTRIES = 1 << 20


def strength_bin(strength: int) -> int:
    """The bin of a strength byte."""
    doublings = max(strength.bit_length() - EXACT_STRENGTHS.bit_length(), 0)
    return (strength >> doublings) + EXACT_STRENGTHS * doublings


def opacity_of_code(code: int) -> float:
    """The opacity 0..1 that a 12-bit code stands for."""
    exponent, mantissa = code >> 8, code & 255
    units = mantissa if exponent == 0 else (256 + mantissa) << (exponent - 1)
    return units / OPACITY_UNIT


def code_of_opacity(opacity: float) -> int:
    """The nearest code, halves up. `opacity` is 0..1; values below half the smallest code give 0."""
    fine = int(min(max(opacity, 0.0), 1.0) * (OPACITY_UNIT * 256) + 0.5)  # in 1/256 of the smallest step
    exponent = max(fine.bit_length() - 16, 0)
    if exponent <= 1:
        return (fine + 128) >> 8
    shift = exponent + 7
    return min((exponent << 8) + ((fine + (1 << (shift - 1))) >> shift) - 256, OPACITY_CODES - 1)
