"""An image that a machine has no room for is refused in a line, and what fits is drawn as before."""

from pathlib import Path

import pytest

from volsplat.client.memory.array_volume import Volume
from volsplat.client.phantoms import make_phantom
from volsplat.client.session.single import SingleProcess
from volsplat.program import machine_limits
from volsplat.protocol.description.scene import Step
from volsplat.protocol.text.errors import BadInput

SIDE = 2048
NEEDED = 2 * 16 * SIDE**2  # bytes


@pytest.fixture
def meminfo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What this process takes for the system's word of how much is left."""
    path = tmp_path / "meminfo"
    monkeypatch.setattr(machine_limits, "MEMINFO", path)
    return path


def leave(meminfo: Path, count: int) -> None:
    meminfo.write_text(f"MemTotal: {1 << 30} kB\nMemAvailable: {count >> 10} kB\n", encoding="ascii")


def test_an_image_too_large_is_refused_and_the_next_one_drawn(meminfo: Path) -> None:
    leave(meminfo, 2 * NEEDED)
    with SingleProcess(Volume(make_phantom("shells", size=(8, 8, 8))[0], spacing=(1.0, 1.0, 1.0))) as single:
        small = single.volume.default_scene()
        large = small.with_(size=(SIDE, SIDE))
        leave(meminfo, NEEDED - 4096)
        with pytest.raises(BadInput, match=r"^no memory for an image of 2048 x 2048 pixels: it needs 128\.0 MiB, but "):
            single.render(large, Step.A)
        expected = single.render(small)
        leave(meminfo, NEEDED)
        image = single.render(large, Step.A)
        leave(meminfo, 0)
        assert single.render(large, Step.A).equal(image), "what is held need not be found again"
        assert single.render(small).equal(expected)
