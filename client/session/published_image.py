"""An image as a splat server published it, which becomes a tensor only when one is asked for."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor


class PublishedImage:
    """(H, W, 4) float32, associated alpha, 0..1, without the background.

    Importing torch takes a second, for which a first picture should not wait.
    """

    def __init__(self, memory: bytearray | memoryview, width: int, height: int) -> None:
        self.memory = memory
        self.width = width
        self.height = height

    @classmethod
    def of(cls, tensor: Tensor) -> PublishedImage:
        height, width, _ = tensor.shape
        return cls(tensor.contiguous().numpy().data.cast("B"), width, height)

    @cached_property
    def tensor(self) -> Tensor:
        """Over the same memory."""
        import torch

        return torch.frombuffer(self.memory, dtype=torch.float32).reshape(self.height, self.width, 4)
