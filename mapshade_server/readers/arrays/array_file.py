"""An array as it lies in a file: any number of axes, uncompressed, in C's or Fortran's order.

What is picked of it is read into memory of our own. A file that is mapped instead, and cut short by another program,
ends the process by SIGBUS.
"""

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.reading.stored_voxels import READ_THROUGH_BYTES, fill

LARGEST_READ_THROUGH = 64 << 20  # bytes that are held at once with gaps between what is wanted


@dataclass(frozen=True)
class ArrayFile:
    """Where the numbers lie; `dtype` has the file's byte order."""

    path: Path
    offset: int
    dtype: "np.dtype[Any]"
    shape: tuple[int, ...]
    order: Literal["C", "F"]

    def pick(self, selection: tuple[int | slice, ...]) -> NDArray[Any]:
        """What indexing the array would give, for indices and slices without steps, all of them within the shape.

        It is C-contiguous and in native byte order. Raises EOFError if the file ends too early, OSError if it
        cannot be read.
        """
        wanted = [(n, n + 1) if isinstance(n, int) else (n.start, n.stop) for n in selection]
        picked = np.empty([high - low for low, high in wanted], self.dtype)
        with self.path.open("rb", buffering=0) as file:
            if self.order == "C":
                self._read(file.fileno(), picked, wanted, self.shape, self.offset)
            else:
                self._read(file.fileno(), picked.T, wanted[::-1], self.shape[::-1], self.offset)
        if not self.dtype.isnative:
            picked = picked.byteswap(inplace=True).view(self.dtype.newbyteorder("="))
        one_of = tuple(0 if isinstance(n, int) else slice(None) for n in selection)
        return picked[one_of] if 0 in one_of else picked

    def _read(
        self, descriptor: int, into: NDArray[Any], wanted: list[tuple[int, int]], shape: tuple[int, ...], at: int
    ) -> None:
        """Fill `into` with what is wanted of an array in C's order that begins at `at` in the file."""
        (low, high), *inner = wanted
        lengths = shape[1:]
        step = math.prod(lengths) * self.dtype.itemsize
        all_of_it = all(ends == (0, length) for ends, length in zip(inner, lengths, strict=True))
        little = (high - low) * step <= LARGEST_READ_THROUGH or not inner
        if all_of_it and into.flags.c_contiguous:
            fill(descriptor, into, at + low * step)
        elif little and self._gap(inner, lengths, step) <= READ_THROUGH_BYTES:
            through = np.empty((high - low, *lengths), self.dtype)
            fill(descriptor, through, at + low * step)
            into[...] = through[(slice(None), *(slice(*ends) for ends in inner))]
        else:
            for n in range(low, high):
                self._read(descriptor, into[n - low], inner, lengths, at + n * step)

    def _gap(self, inner: list[tuple[int, int]], lengths: tuple[int, ...], step: int) -> int:
        """Bytes between what is wanted at one index of an axis and at the next; on axes further in it is less."""
        extent, stride = self.dtype.itemsize, self.dtype.itemsize
        for (low, high), length in zip(inner[::-1], lengths[::-1], strict=True):
            extent += (high - low - 1) * stride
            stride *= length
        return step - extent

    @property
    def nbytes(self) -> int:
        return math.prod(self.shape) * self.dtype.itemsize


def cause(error: OSError | EOFError) -> str:
    """Why the numbers cannot be read."""
    if isinstance(error, EOFError):
        return "it was cut short while it was read"
    return f"it cannot be read ({os.strerror(error.errno or 0)})"
