"""The picture that a volume is first seen in, whatever file or array it is: not empty, no block, no noise, well framed.

What the score cannot see, as whether a head stands upright, is seen on the sheet (sheet.py).
"""

from collections.abc import Callable
from pathlib import Path
from statistics import median

import msgspec
import numpy as np
import pytest
from first_pictures.peer_scripts import TOOLS
from first_pictures.peers import VOLUMES as PEER_VOLUMES
from first_pictures.preset_sheet import VOLUMES
from first_pictures.score import Score, score
from first_pictures.sheet import first_pictures
from first_pictures.subjects import HEAD, MORE, PHANTOM_SIDES, Subject, heads, phantoms, real_volumes
from numpy.typing import NDArray

from volsplat.client.image.image_file import over_background
from volsplat.client.memory.array_volume import Volume
from volsplat.client.phantoms import make_phantom
from volsplat.client.scene.presets import PRESETS
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.shading_tables import ColourTable, ScalarTable

SIDE = 128  # pixels
AIMED_LONGER_SIDE = 0.9  # of half of all pictures

pytestmark = pytest.mark.filterwarnings("ignore::volsplat.client.memory.array_volume.OrientationUnknown")


def test_first_pictures_of_real_volumes_show_something_and_half_of_them_fill_their_frame(shared_data: Path) -> None:
    drawn = list(first_pictures((one for one in real_volumes() if one.name not in MORE), SIDE))
    assert {one.subject.name: one.faults for one in drawn if one.faults} == {}
    assert median(one.score.longer_side for one in drawn) >= AIMED_LONGER_SIDE


@pytest.mark.parametrize("made", [phantoms, heads], ids=["of each phantom", "of a head in each format and array"])
def test_first_pictures_show_something(made: Callable[[], list[Subject]]) -> None:
    assert {one.subject.name: one.faults for one in first_pictures(made(), SIDE) if one.faults} == {}


# What the score is worth: a head that was spoilt fails for the right reason.


def scored(values: NDArray[np.generic], spoilt: Callable[[Scene], Scene] = lambda scene: scene) -> Score:
    with SingleProcess(Volume(values, spacing=(1, 1, 1))) as single:
        scene = single.volume.settled(spoilt(single.volume.default_scene().with_(size=SIDE)))
        picture = over_background(single.finish(scene).published.pixels, scene.image.background)
        return score(picture, float(scene.view.zoom), scene.image.background)


def tables(scene: Scene, **changed: ScalarTable | ColourTable) -> Scene:
    return msgspec.structs.replace(scene, tables=msgspec.structs.replace(scene.tables, **changed))


def unmodulated(scene: Scene) -> Scene:
    return msgspec.structs.replace(scene, shading=msgspec.structs.replace(scene.shading, modulation=False))


WHITE = ColourTable(points=((0.0, (1.0, 1.0, 1.0)),))
SPOILT: dict[str, Callable[[Scene], Scene]] = {
    "empty": lambda scene: tables(scene, opac=ScalarTable(points=((0.0, 0.0),))),
    "block": lambda scene: tables(unmodulated(scene), opac=ScalarTable(points=((0.0, 1.0),))),
    "burnt out": lambda scene: tables(scene, emit=WHITE),
    "plain": lambda scene: tables(scene, emit=WHITE),
    "cut": lambda scene: scene.with_(zoom=4),
    "small": lambda scene: scene.with_(zoom=0.5),
}


@pytest.fixture(scope="module")
def head() -> NDArray[np.generic]:
    return make_phantom("head", size=HEAD)[0].numpy()


@pytest.mark.parametrize("fault", SPOILT)
def test_a_spoilt_picture_is_told(fault: str, head: NDArray[np.generic]) -> None:
    assert scored(head).faults() == []
    assert fault in {told.partition(":")[0] for told in scored(head, SPOILT[fault]).faults()}


@pytest.mark.parametrize("side", [16, PHANTOM_SIDES])
def test_noise_is_told(side: int) -> None:
    random = np.random.default_rng(side)
    for values in (random.integers(0, 255, (side,) * 3, np.uint8), random.normal(0, 1, (side,) * 3).astype(np.float32)):
        assert any(told.startswith("noise") for told in scored(values).faults())


def test_the_sheet_in_the_docs_has_a_volume_for_each_preset() -> None:
    assert set(VOLUMES) == set(PRESETS)


@pytest.mark.parametrize("tool", TOOLS)
def test_what_other_tools_are_asked_is_python_that_reads_and_writes(tool: str) -> None:
    scripts = TOOLS[tool].scripts
    assert set(scripts) <= set(PEER_VOLUMES)
    for script in scripts.values():
        assert "FILE" in script and ("PICTURE" in script) != TOOLS[tool].in_notebook
        compile(script, tool, "exec")
