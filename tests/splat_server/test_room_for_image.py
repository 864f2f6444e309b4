"""An image that a machine has no room for is refused in a line, and what fits is drawn as before."""

from pathlib import Path

import psutil
import pytest

from volsplat.client.memory.array_volume import Volume
from volsplat.client.phantoms import make_phantom
from volsplat.client.session.single import SingleProcess
from volsplat.program import machine_limits
from volsplat.protocol.description.refinement_steps import Step
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


def test_planes_of_slabs_that_are_too_large_are_refused_and_the_next_image_drawn(meminfo: Path) -> None:
    """They take several times what the image does, and are let go once it is drawn."""
    leave(meminfo, 1 << 40)
    with SingleProcess(Volume(make_phantom("shells", size=(8, 8, 8))[0], spacing=(1.0, 1.0, 1.0))) as single:
        scene = single.volume.default_scene().with_(size=(SIDE, SIDE))
        image = single.render(scene, Step.A)
        leave(meminfo, NEEDED // 2)
        with pytest.raises(
            BadInput, match=r"^no memory for step G's planes of 2048 x 2048 pixels: it needs .* step F$"
        ):
            single.render(scene, Step.G)
        assert single.render(scene, Step.A).equal(image)


def test_what_is_asked_for_holds_the_planes_that_are_kept_beside_the_sums(meminfo: Path) -> None:
    """Of each pixel, sums of 4 bytes by blocks of 8 planes, and densities of the last three planes before."""
    leave(meminfo, 1 << 40)
    with SingleProcess(Volume(make_phantom("shells", size=(8, 8, 8))[0], spacing=(1.0, 1.0, 1.0))) as single:
        scene = single.volume.default_scene().with_(size=(SIDE, SIDE))
        single.render(scene, Step.A)
        leave(meminfo, NEEDED // 2)
        with pytest.raises(BadInput, match=r"planes .* it needs [0-9.]+ MiB") as refused:
            single.render(scene, Step.G)
    needed = float(str(refused.value).split("it needs ")[1].split(" MiB")[0]) * 2**20 / SIDE**2
    assert needed % (8 * 4) == 3 * 4


def test_planes_of_slabs_are_let_go_once_the_image_is_drawn() -> None:
    with SingleProcess(Volume(make_phantom("shells", size=(32, 32, 32))[0], spacing=(1.0, 1.0, 1.0))) as single:
        scene = single.volume.default_scene().with_(size=(SIDE, SIDE))
        single.render(scene, Step.F)
        before = psutil.Process().memory_info().rss
        single.render(scene, Step.G)
        planes = 60 * SIDE**2  # bytes, of float sums alone
        assert psutil.Process().memory_info().rss - before < planes / 3
