"""Scenes changed from Python in as few words as in TOML, colours and colour maps by their names."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from volsplat.client.scene.colour_maps import COLLECTIONS, colormap
from volsplat.client.scene.presets import preset_scene
from volsplat.client.scene.scene_file import scene_from_toml
from volsplat.protocol.description.scene import Shading
from volsplat.protocol.description.shading_tables import ColourTable, ScalarTable
from volsplat.protocol.text.errors import BadInput

SCENE = preset_scene("ct-skin")
RED = (1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("changes", "toml"),
    [
        ({"size": (300, 200)}, "image.width = 300\nimage.height = 200"),
        ({"size": (np.int32(300), np.int64(200))}, "image.width = 300\nimage.height = 200"),
        ({"size": 300}, "image.width = 300\nimage.height = 300"),
        ({"rotation": "top", "zoom": np.float32(2)}, "view = {rotation = [0, 0, 1, 0], zoom = 2}"),
        ({"rotation": np.array([0.0, 0.0, 0.0, 1.0])}, "view.rotation = [0, 0, 0, 1]"),
        ({"background": "Red"}, "image.background = 'red'"),
        ({"background": [1, 0, 0], "edges": True}, "image = {background = '#ff0000', edges = true}"),
        ({"opac": [(0, 0), (0.5, 1)]}, "tables.opac.points = [[0, 0], [0.5, 1]]"),
        ({"emit": [(0, "red")]}, "tables.emit.points = [[0, [1, 0, 0]]]"),
        ({"bounds": ((0, 0, 0), (9, 8, 7))}, "bounds = {low = [0, 0, 0], high = [9, 8, 7]}"),
        ({"kernel": "cone", "window": (-100, 300)}, "reconstruction.kernel = 'cone'\nquantise.window = [-100, 300]"),
        ({"shading": Shading(), "specular_power": 9}, "shading.specular_power = 9"),
    ],
)
def test_a_change_is_what_toml_would_make_of_the_scene(changes: dict[str, Any], toml: str) -> None:
    named = SCENE.with_(shading=Shading())
    wanted = scene_from_toml(toml, named, "toml")
    changed = named.with_(**changes)
    assert changed.view.rotation == pytest.approx(wanted.view.rotation)
    assert changed.with_(rotation=(0, 0, 0, 1)) == wanted.with_(rotation=(0, 0, 0, 1))


def test_angles_and_names_of_views_are_the_same() -> None:
    assert SCENE.with_(rotation=(90, 0)).view == SCENE.with_(rotation="right").view


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"zom": 2}, "a scene has no zom; did you mean zoom?"),
        ({"anything": 2}, "a scene has no anything; it has size, rotation, bounds"),
        ({"zoom": 1000}, "zoom=1000: "),
        ({"zoom": "big"}, "allowed: 1/64 to 256 pixels"),
        ({"rotation": "frnt"}, "rotation='frnt': is none of front, back"),
        ({"rotation": (1,)}, "needs a quaternion, or azimuth and elevation"),
        ({"background": "reddish"}, "'reddish' is not a colour"),
        ({"size": "large"}, "allowed: pixels, or (width, height)"),
        ({"light": 3}, "light=3: is no Light"),
        ({"opac": ColourTable(points=((0.0, RED),))}, "is no ScalarTable"),
        ({"emit": 3}, "emit=3: "),
        ({"bounds": 3}, "the first voxel and one past the last"),
    ],
)
def test_what_a_scene_cannot_have_is_refused_in_a_line(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(BadInput) as raised:
        SCENE.with_(**changes)
    assert message in str(raised.value) and "\n" not in str(raised.value)


@pytest.mark.parametrize("size", [64.0, np.float32(64), (64.0, 64), np.array([64, 64])])
def test_a_size_in_whole_numbers_of_any_kind_is_taken(size: Any) -> None:
    image = SCENE.with_(size=size).image
    assert (image.width, image.height) == (64, 64)


@pytest.mark.parametrize("size", [64.5, None, "64", (64,), float("nan")])
def test_a_size_that_is_none_is_refused(size: Any) -> None:
    with pytest.raises(BadInput, match=r"allowed: pixels, or \(width, height\)"):
        SCENE.with_(size=size)


def test_a_colour_map_is_a_table() -> None:
    import matplotlib

    table = SCENE.with_(emit=colormap("viridis")).tables.emit
    map_itself = matplotlib.colormaps["viridis"](np.linspace(0, 1, 256))[:, :3]
    assert np.allclose(table.entries(), map_itself)
    assert colormap(matplotlib.colormaps["viridis"]) == table
    placed = colormap("gray", 0.25, 0.5)
    assert placed.points[0] == (0.25, (0.0, 0.0, 0.0)) and placed.points[-1] == (0.5, (1.0, 1.0, 1.0))
    assert not isinstance(placed, ScalarTable)


@pytest.mark.parametrize(
    ("name", "places", "message"),
    [
        ("virdis", (0, 1), "did you mean viridis?"),
        ("viridis", (0.5, 0.5), "lies between low and high"),
        ("viridis", ("low", 1), "low must be a number"),
        (None, (0, 1), "a colour map is named by a text, as 'magma', or is matplotlib's own, not None"),
    ],
)
def test_a_colour_map_that_is_not_there_is_refused(name: Any, places: tuple[float, float], message: str) -> None:
    with pytest.raises(BadInput) as raised:
        colormap(name, *places)
    assert message in str(raised.value)


def test_a_colour_map_whose_library_is_missing_or_broken_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(COLLECTIONS, "none_", "volsplat_has_no_such_library")
    with pytest.raises(BadInput, match="run pip install volsplat_has_no_such_library"):
        colormap("none_fire")
    (tmp_path / "volsplat_broken_library.py").write_text("import volsplat_has_no_such_library", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(COLLECTIONS, "broken_", "volsplat_broken_library")
    with pytest.raises(BadInput, match="does not load .*no_such_library.*; install it anew"):
        colormap("broken_fire")
