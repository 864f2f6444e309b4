"""How many bytes a process reads, for the tests of what readers leave unread."""

from pathlib import Path

import pytest


def bytes_read() -> int:
    """How many bytes this process has read so far, from the cache or not."""
    counts = Path("/proc/self/io")
    if not counts.is_file():
        pytest.skip("this system does not count the bytes that a process reads")
    return int(counts.read_text(encoding="utf-8").split()[1])
