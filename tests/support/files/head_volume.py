"""The small head in a file, drawn by a single process, with the scene of its skin: fixtures for whole-program tests.

A test module imports the fixtures that it wants by name, with those that they need, and names them in `__all__`, which
tells ruff that they are used.
"""

from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.scene.presets import preset_scene
from volsplat.client.session.renderer import Renderer
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.scene import Image, Scene

SIZE = (32, 40, 36)  # voxels
SMALL = Image(width=96, height=80)


@pytest.fixture(scope="module")
def head(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("volumes") / "head.mha"
    write_volume(path, *make_phantom("head", size=SIZE))
    return path


@pytest.fixture(scope="module")
def single(head: Path) -> Iterator[SingleProcess]:
    with SingleProcess(head) as single:
        yield single


@pytest.fixture
def scene(single: SingleProcess) -> Scene:
    return skin(single)


def skin(renderer: Renderer, image: Image = SMALL) -> Scene:
    """The volume's skin in an image of this size."""
    volume = renderer.volume
    scene = preset_scene("ct-skin", volume.subject())
    return msgspec.structs.replace(scene, image=image)
