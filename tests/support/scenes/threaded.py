"""Has even the smallest jobs shared among threads, which would otherwise be done at once."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from volsplat.splat_server import image_buffer


@contextmanager
def everything_threaded() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(image_buffer, "THREADED_FROM", 0)
        patch.setattr(image_buffer, "THREADED_FROM_PIXELS", 0)
        yield
