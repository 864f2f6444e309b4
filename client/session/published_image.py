"""An image as a splat server published it: for the client's own files a numpy array, for Python a tensor."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

from volsplat.program.extras import need

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray
    from torch import Tensor


class PublishedImage:
    """(H, W, 4) float32, associated alpha, 0..1, without the background."""

    def __init__(self, memory: bytearray | memoryview, width: int, height: int) -> None:
        self.memory = memory
        self.width = width
        self.height = height

    @classmethod
    def of(cls, pixels: ArrayLike) -> PublishedImage:
        import numpy as np

        array = np.ascontiguousarray(pixels, np.float32)
        height, width, _ = array.shape
        return cls(array.data.cast("B"), width, height)

    @cached_property
    def pixels(self) -> NDArray[np.float32]:
        """Over the same memory."""
        import numpy as np  # a session must not wait for it before it starts its servers

        return np.frombuffer(self.memory, np.float32).reshape(self.height, self.width, 4)

    @cached_property
    def tensor(self) -> Tensor:
        """Over the same memory. Raises BadInput without the extra [torch]."""
        need("torch", "an image as a tensor", "torch")
        import torch  # takes more than a second, so that only who asks for a tensor pays for it

        return torch.frombuffer(self.memory, dtype=torch.float32).reshape(self.height, self.width, 4)
