"""What the command line says of the scene, and the scenes that it prints."""

import json
import math
from pathlib import Path
from typing import Any

import pytest

from support.programs.programs import Person
from volsplat.client.caller.meant import nearest
from volsplat.client.command.render_options import SceneOptions
from volsplat.client.image.image_file import read_scene
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.scene.presets import preset_scene
from volsplat.client.scene.scene_file import scene_from_toml
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.scene import Kernel, Scene, Step
from volsplat.protocol.text.errors import BadInput

NOTHING: dict[str, Any] = {"scene": None, "preset": "ct-bone", "put": (), "fit": None}


def options(**given: Any) -> Scene:
    return SceneOptions.of(NOTHING | given).scene_of(None)


@pytest.fixture
def person(tmp_path: Path) -> Person:
    return Person(tmp_path)


@pytest.mark.parametrize(
    ("given", "changes"),
    [
        ({"size": "300"}, {"size": 300}),
        ({"size": "300x200"}, {"size": (300, 200)}),
        ({"background": "white"}, {"background": "white"}),
        ({"background": "#102030"}, {"background": "#102030"}),
        ({"window": "-160,240"}, {"window": (-160.0, 240.0)}),
        ({"kernel": "cone"}, {"kernel": Kernel.CONE}),
        ({"put": ("shading.specular_power=20", "light.fixed_to = grid")}, {"specular_power": 20.0, "fixed_to": "grid"}),
    ],
)
def test_an_option_is_a_change_of_a_key(given: dict[str, Any], changes: dict[str, Any]) -> None:
    assert options(**given) == preset_scene("ct-bone").with_(**changes)


def test_fit_overrules_the_scene_s_zoom_and_centre(tmp_path: Path) -> None:
    write_volume(tmp_path / "shells.nrrd", *make_phantom("shells", size=(24, 28, 20)))
    given = NOTHING | {"put": ("view.zoom=9", "view.center=[1, 2, 3]"), "size": "64"}
    with SingleProcess(str(tmp_path / "shells.nrrd")) as single:
        visible, whole = (SceneOptions.of(given | {"fit": fit}).scene_of(single.volume) for fit in ("visible", "all"))
        dims = single.volume.description.geometry.dims
    assert (visible.view.zoom, visible.view.center) == ("fit", "middle")
    assert whole.view.center == tuple((n - 1) / 2 for n in dims)
    assert whole.view.zoom == pytest.approx(0.98 * 64 / math.hypot(*dims))
    with pytest.raises(BadInput, match="leave out --zoom and --center, or --fit"):
        options(fit="all", zoom=3.0)


def test_a_colour_map_colours_what_glows_and_what_is_lit() -> None:
    pytest.importorskip("matplotlib")
    tables, plain = options(colormap="gray").tables, preset_scene("ct-bone").tables
    for entries in (tables.emit.entries(), tables.refl.entries()):
        assert entries[0] == (0.0, 0.0, 0.0) and all(red == green == blue for red, green, blue in entries)
    assert max(tables.refl.entries()) > max(tables.emit.entries()) > (0.0, 0.0, 0.0)
    assert (tables.opac, tables.modu) == (plain.opac, plain.modu)


@pytest.mark.parametrize(
    ("given", "word"), [("CT-BONE", "ct-bone"), ("ct-bnoe", "ct-bone"), ("Ct_skin", "ct-skin"), ("xyzzy", None)]
)
def test_a_word_that_is_nearly_one_is_found_whatever_the_case(given: str, word: str | None) -> None:
    assert nearest(given, ["ct-bone", "ct-skin", *Step]) == word


def test_the_scene_of_a_volume_and_of_an_image_is_what_is_drawn(person: Person) -> None:
    """Tables are made for the window that is asked for; what `scene` prints draws the same image."""
    write_volume(person.folder / "head.nrrd", *make_phantom("head", size=(32, 40, 36)))
    facts = json.loads(person.runs("info", "head.nrrd", "--json").stdout)
    assert (facts["dims"], facts["scalar_type"], facts["voxels"]) == ([32, 40, 36], "uint16", 32 * 40 * 36)
    low, high = facts["range"]
    assert sum(facts["histogram"]["counts"]) == facts["voxels"] and list(facts["percentiles"]) == sorted(
        facts["percentiles"], key=lambda share: int(share[:-1])
    )
    asked = ["--window", f"{low},{(low + high) / 2}", "--size", "64", "--background", "white"]
    assert person.runs("render", "head.nrrd", "-o", "head.png", "--single", *asked).returncode == 0
    drawn = read_scene(person.folder / "head.png")
    assert drawn.quantise.window == (low, (low + high) / 2) and drawn.image.background == (1.0, 1.0, 1.0)
    for source, more in (("head.png", []), ("head.nrrd", asked)):
        printed = person.runs("scene", source, *more)
        assert printed.returncode == 0, printed.stderr
        assert scene_from_toml(printed.stdout, preset_scene("ct-skin"), source) == drawn
