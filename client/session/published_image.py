"""An image as splat servers published it: for the client's own files a numpy array, for Python a tensor."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

from volsplat.client.caller.whole_torch import load_torch
from volsplat.client.coordinator.events.instructions import ImagePart

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray
    from torch import Tensor


class PublishedImage:
    """(H, W, 4) float32, associated alpha, 0..1, without the background."""

    def __init__(self, memory: bytearray | memoryview, width: int, height: int, exact: bool = True) -> None:
        """`exact` unless it has come with 8 bits a channel."""
        self.memory = memory
        self.exact = exact
        self.width = width
        self.height = height

    @classmethod
    def of(cls, pixels: ArrayLike) -> PublishedImage:
        import numpy as np

        array = np.ascontiguousarray(pixels, np.float32)
        height, width, _ = array.shape
        return cls(array.data.cast("B"), width, height)

    @classmethod
    def of_parts(cls, parts: Sequence[ImagePart], width: int, height: int) -> PublishedImage:
        """Laid together; in the memory of the one part if there are no others. Empty where there is none."""
        if len(parts) == 1 and parts[0].rectangle == (0, 0, width, height):
            return cls(parts[0].pixels, width, height, parts[0].read.exact)
        import numpy as np

        whole = np.zeros((height, width, 4), np.float32)
        for part in parts:
            left, top, columns, rows = part.rectangle
            pixels = np.frombuffer(part.pixels, np.float32).reshape(rows, columns, 4)
            whole[top : top + rows, left : left + columns] = pixels
        return cls(whole.data.cast("B"), width, height, all(part.read.exact for part in parts))

    def __reduce__(self) -> tuple[Any, ...]:
        """For pickle, as of processes that draw for one another."""
        return PublishedImage, (bytearray(self.memory), self.width, self.height, self.exact)

    @cached_property
    def pixels(self) -> NDArray[np.float32]:
        """Over the same memory."""
        import numpy as np  # a session must not wait for it before it starts its servers

        return np.frombuffer(self.memory, np.float32).reshape(self.height, self.width, 4)

    @cached_property
    def tensor(self) -> Tensor:
        """Over the same memory. Raises BadInput without the extra [torch]."""
        load_torch("an image as a tensor")
        import torch

        return torch.frombuffer(self.memory, dtype=torch.float32).reshape(self.height, self.width, 4)
