"""Scenes as TOML: what is written reads back equal, and what is wrong is named with its place."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.scenes.scenes import scenes
from volsplat.client.scene.scene_file import read_scene_file, scene_from_toml, scene_toml
from volsplat.protocol.description.scene import Scene, View
from volsplat.protocol.description.scene_key import Part, declarations
from volsplat.protocol.description.scene_keys import KEYS, SECTIONS
from volsplat.protocol.description.shading_tables import ColourTable, Field, ScalarTable, Tables
from volsplat.protocol.text.errors import BadInput

BASE = Scene(
    tables=Tables(
        emit=ColourTable(points=((0.0, (0.0, 0.0, 0.0)), (1.0, (1.0, 1.0, 1.0)))),
        refl=ColourTable(points=((0.0, (1.0, 1.0, 1.0)),)),
        opac=ScalarTable(points=((0.25, 0.0), (1.0, 0.5))),
    ),
    view=View(zoom=2.5),
)


def test_every_key_of_a_scene_says_what_it_means_and_what_may_stand_there() -> None:
    builtins = msgspec.to_builtins(BASE)
    assert set(KEYS) == set(leaves(builtins))
    for key in KEYS.values():
        assert key.allowed and (key.meaning or key.section.startswith("tables.")), key.place
        assert SECTIONS[key.section] or key.section == "", key.place


def leaves(builtins: dict[str, Any], section: str = "") -> Iterator[str]:
    for name, value in builtins.items():
        place = f"{section}.{name}".removeprefix(".")
        if isinstance(value, dict):
            yield from leaves(value, place)
        else:
            yield place


def test_a_key_that_declares_nothing_is_refused_by_name() -> None:
    class Silent(Part, frozen=True):
        depth: float = 1.0

    with pytest.raises(TypeError, match=r"Silent\.depth declares no Key or Section"):
        declarations(Silent)


@given(scene=scenes(), title=st.text())
def test_a_written_scene_reads_back_equal_over_any_base(scene: Scene, title: str) -> None:
    assert scene_from_toml(scene_toml(scene, title), BASE, "scene.toml") == scene


@given(scene=scenes())
def test_a_written_scene_has_every_key_with_its_allowed_values(scene: Scene) -> None:
    text = scene_toml(scene)
    for key in KEYS.values():
        assert f"\n{key.name} = " in text
        assert f"Allowed: {key.allowed}." in " ".join(line.removeprefix("# ") for line in text.splitlines())


@given(
    text=st.text() | st.lists(st.sampled_from(["[view]", "zoom=", "'x'", "\n", "1e999", "[[", "]]", "="])).map("".join)
)
def test_any_text_gives_a_scene_or_one_line(text: str) -> None:
    try:
        scene_from_toml(text, BASE, "scene.toml")
    except BadInput as error:
        assert str(error).startswith("scene.toml:")
        assert "\n" not in str(error)


def test_what_a_file_leaves_out_comes_from_the_base() -> None:
    scene = scene_from_toml("[image]\nwidth = 100\n[cross_bar]\nemit = 'screen-z'\n", BASE, "scene.toml")
    assert scene.image.width == 100
    assert scene.cross_bar.emit is Field.SCREEN_Z
    assert scene.view == BASE.view
    assert scene.tables == BASE.tables


def test_colours_may_be_hexadecimal_or_numbers() -> None:
    scene = scene_from_toml(
        "image.background = '#ff0080'\ntables.emit.points = [[0, '#00ff00'], [1, [0.25, 0, 1]]]", BASE, "scene.toml"
    )
    assert scene.image.background == (1.0, 0.0, 128 / 255)
    assert scene.tables.emit.points == ((0.0, (0.0, 1.0, 0.0)), (1.0, (0.25, 0.0, 1.0)))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[view]\nzooom = 2", "view.zooom: unknown key; did you mean zoom?"),
        ("zoom = 2", "zoom: unknown key; did you mean view.zoom?"),
        ("[viev]\nzoom = 2", "viev: unknown key; did you mean view?"),
        ("xyzzy = 2", "xyzzy: unknown key; a scene has tables, cross_bar, "),
        ("[light]\nxyzzy = 2", "light.xyzzy: unknown key; [light] has direction, fixed_to"),
        ("view = 3", "view: must be a table of keys, [view], not 3"),
        ("tables.emit.points = {a = 1}", "tables.emit.points: {'a': 1} cannot be used; allowed: [[position, colour]"),
        ("view.zoom = 1000", 'view.zoom: must be 1/64 to 256 pixels per voxel or "fit", not 1000.0'),
        ("view.zoom = nan", 'view.zoom: must be 1/64 to 256 pixels per voxel or "fit", not nan'),
        ("view.zoom = 'big'", "view.zoom: 'big' cannot be used; allowed: 1/64 to 256 pixels"),
        ("view.zoom = true", "view.zoom: true cannot be used; allowed: 1/64 to 256 pixels"),
        ("view.rotation = [0, 0, 1]", "view.rotation: [0, 0, 1] cannot be used; allowed: [x, y, z, w], a quaternion"),
        ("view.rotation = [0, 0, 0, 0]", "view.rotation: must not be all zeros"),
        ("light.direction = [0, 'up', 0]", "light.direction[1]: 'up' cannot be used; allowed: [x, y, z]"),
        ("order = 'front'", 'order: \'front\' cannot be used; allowed: one of "fastest", "btf", "ftb"'),
        ("cross_bar.emit = 'depth'", "cross_bar.emit: 'depth' cannot be used; allowed: one of \"density\""),
        ("image.width = 0", "image.width: must be 1 to 16384 pixels, not 0"),
        ("image.width = 1.5", "image.width: 1.5 cannot be used; allowed: 1 to 16384 pixels"),
        (
            "image.background = 'reddish'",
            "image.background: 'reddish' is not a colour; write \"#rrggbb\", a name of CSS or [r, g, b]",
        ),
        ("image.background = [0, 0, 2]", "image: a background channel must be 0 to 1, not 2.0"),
        ("tables.emit.points = [[0, '#12']]", "tables.emit.points[0][1]: '#12' is not a colour"),
        ("tables.opac.points = [[0, 0.5], [0.5]]", "tables.opac.points[1]: [0.5] cannot be used; allowed: [[position,"),
        ("tables.opac.points = [[1, 0], [0, 1]]", "tables.opac.points: must be in rising order of position"),
        ("quantise.window = [5, 5]", "quantise.window: must rise, not [5.0, 5.0]"),
    ],
)
def test_a_wrong_key_or_value_is_named_with_its_place(text: str, message: str) -> None:
    with pytest.raises(BadInput) as raised:
        scene_from_toml(text, BASE, "scene.toml")
    assert str(raised.value).startswith(f"scene.toml: {message}")
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("text", "place"),
    [("[view]\nzoom 3\n", "scene.toml:2:6: "), ("order = 'btf'\norder = 'ftb'\n", "scene.toml:2:")],
)
def test_a_syntax_error_is_named_with_line_and_column(text: str, place: str) -> None:
    with pytest.raises(BadInput) as raised:
        scene_from_toml(text, BASE, "scene.toml")
    assert str(raised.value).startswith(place)


@pytest.mark.parametrize(
    "text", ["a = " + 5000 * "[", "bounds.low = [" + 5000 * "9" + ", 0, 0]", "view.zoom = 0x" + 5000 * "f"]
)
def test_hostile_toml_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(BadInput) as raised:
        scene_from_toml(text, BASE, "scene.toml")
    assert "\n" not in str(raised.value)


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="absent.toml: cannot read the scene: No such file"):
        read_scene_file(tmp_path / "absent.toml", BASE)
    with pytest.raises(BadInput, match="cannot read the scene: Is a directory"):
        read_scene_file(tmp_path, BASE)
    (tmp_path / "picture.toml").write_bytes(b"\x89PNG")
    with pytest.raises(BadInput, match="not a scene file: byte 0 is not UTF-8"):
        read_scene_file(tmp_path / "picture.toml", BASE)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_a_scene_file_is_read_from_disk(tmp_path: Path, encoding: str) -> None:
    """Also as editors on Windows save it, with a mark before the text."""
    path = tmp_path / "scene.toml"
    path.write_text(scene_toml(BASE), encoding=encoding)
    assert read_scene_file(path, BASE) == BASE
