"""What the command line says of the scene, and the scenes that it prints."""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import volsplat as vs
from support.programs.programs import Person
from volsplat.client.command.render_options import SceneOptions
from volsplat.client.command.server_options import Servers
from volsplat.client.command.view_beginning import ViewBeginning
from volsplat.client.image.image_file import read_scene
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.scene.presets import preset_scene
from volsplat.client.scene.scene_file import scene_from_toml, scene_toml
from volsplat.client.session.single import SingleProcess
from volsplat.program.plain_console import PlainConsole
from volsplat.protocol.description.refinement_steps import PaperStep, Step
from volsplat.protocol.description.scene import Kernel, Quantise, Refine, Scene
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.meant import nearest

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
        ({"zoom": "2.5"}, {"zoom": 2.5}),
        ({"zoom": "Fit"}, {"zoom": "fit"}),
        ({"kernel": "cone"}, {"kernel": Kernel.CONE}),
        ({"put": ("shading.specular_power=20", "light.fixed_to = grid")}, {"specular_power": 20.0, "fixed_to": "grid"}),
    ],
)
def test_an_option_is_a_change_of_a_key(given: dict[str, Any], changes: dict[str, Any]) -> None:
    assert options(**given) == preset_scene("ct-bone").with_(**changes)


@pytest.fixture(scope="module")
def scan() -> Iterator[SingleProcess]:
    """A ramp of Hounsfield units."""
    units = np.linspace(-1000, 3000, 16**3, dtype=np.float32).reshape(16, 16, 16)
    with SingleProcess(vs.Volume(units, spacing=(1, 1, 1), space="LPS", kind="CT", value_unit="HU")) as single:
        yield single


@pytest.mark.parametrize("preset", ["ct-bone", None])
@pytest.mark.parametrize("place", ["option", "set", "file", "file under a key", "script", "script, whole"])
def test_tables_are_made_for_the_window_wherever_it_is_set(
    place: str, preset: str | None, scan: SingleProcess, tmp_path: Path
) -> None:
    window = (0.0, 2000.0)
    (file := tmp_path / "window.toml").write_text("[quantise]\nwindow = [0, 2000]\n")
    (key := tmp_path / "key.toml").write_text("[image]\nwidth = 16\n")
    given = NOTHING | {"preset": preset}
    match place:
        case "option":
            scene = SceneOptions.of(given | {"window": "0,2000"}).scene_of(scan.volume)
        case "set":
            scene = SceneOptions.of(given | {"put": ("quantise.window=[0, 2000]",)}).scene_of(scan.volume)
        case "file":
            scene = SceneOptions.of(given | {"scene": file}).scene_of(scan.volume)
        case "file under a key":
            (scene,) = SceneOptions.of(given | {"scene": file}).key_scenes(scan.volume, [key])
        case "script":
            scene = vs.render(scan, preset, window=window, size=16).scene
        case _:
            scene = vs.render(scan, preset, quantise=Quantise(window=window), size=16).scene
    assert scene.quantise.window == window
    assert scene.tables == scan.volume.begun_scene(preset, Quantise(window=window)).tables
    opacity = scene.tables.opac.entries()
    for units, seen in ((100, preset is None), (1200, True)):
        assert (opacity[round(units / 2000 * 255)] > 0) == seen


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
        options(fit="all", zoom="3.0")


@pytest.mark.parametrize("preset", [None, "ct-bone"])
def test_the_page_is_lit_from_its_first_steps_unless_somebody_says_otherwise(
    scan: SingleProcess, preset: str | None
) -> None:
    def refines(*put: str, window: str | None = None) -> Refine:
        said = SceneOptions.of(NOTHING | {"preset": preset, "put": put, "window": window})
        return ViewBeginning(Servers(1, 1), said, None, PlainConsole())._options.scene_of(scan.volume).refine

    assert refines().lit_from is refines(window="0,2000").lit_from is PaperStep.C
    assert refines("refine.lit_from=E").lit_from is PaperStep.E
    said = refines("refine.finest=G", "refine.bare_buffer=true", "refine.striding=true")
    assert said == Refine(lit_from=PaperStep.C, finest=Step.G, bare_buffer=True, striding=True)


@pytest.mark.parametrize("whole", [True, False])
def test_a_preset_of_which_a_scene_file_leaves_nothing_is_told(
    scan: SingleProcess, tmp_path: Path, capsys: pytest.CaptureFixture[str], whole: bool
) -> None:
    file = tmp_path / "scene.toml"
    file.write_text(
        scene_toml(scan.volume.begun_scene("ct-skin")) if whole else "[view]\nzoom = 2.0\n", encoding="utf-8"
    )
    said = SceneOptions.of(NOTHING | {"scene": file, "preset": "ct-bone"})
    alone = SceneOptions.of(NOTHING | {"scene": file, "preset": None})
    assert (said.scene_of(scan.volume) == alone.scene_of(scan.volume)) is whole
    said.tell_unsuited(scan.volume, PlainConsole())
    told = f"note: {file} decides all that --preset ct-bone would; leave one of them out\n"
    assert (told in capsys.readouterr().out) is whole


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
