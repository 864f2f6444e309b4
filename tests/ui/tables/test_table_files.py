"""One table in a file: it reads back equal, is a scene file besides, and what is wrong is told in one line."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.scenes.scenes import scenes
from volsplat.client.scene.scene_file import scene_from_toml, scene_toml
from volsplat.client.ui.tables.table_files import table_from_toml, table_toml
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.shading_tables import ColourTable, ScalarTable, Tables
from volsplat.protocol.text.errors import BadInput

NAMES = ("emit", "refl", "opac", "modu")
BASE = Scene(
    tables=Tables(
        emit=ColourTable(points=((0.0, (0.0, 0.0, 0.0)), (1.0, (1.0, 1.0, 1.0)))),
        refl=ColourTable(points=((0.0, (1.0, 1.0, 1.0)),)),
        opac=ScalarTable(points=((0.25, 0.0), (1.0, 0.5))),
    )
)


@given(scene=scenes(), which=st.sampled_from(NAMES))
def test_a_saved_table_reads_back_equal(scene: Scene, which: str) -> None:
    assert table_from_toml(table_toml(scene, which), BASE, which, "table.toml") == getattr(scene.tables, which)


@given(scene=scenes(), which=st.sampled_from(NAMES))
def test_a_saved_table_is_a_scene_file_of_that_table_alone(scene: Scene, which: str) -> None:
    read = scene_from_toml(table_toml(scene, which), BASE, "table.toml")
    assert read == msgspec.structs.replace(
        BASE, tables=msgspec.structs.replace(BASE.tables, **{which: getattr(scene.tables, which)})
    )


@given(scene=scenes(), which=st.sampled_from(NAMES))
def test_a_table_is_taken_out_of_a_whole_scene(scene: Scene, which: str) -> None:
    assert table_from_toml(scene_toml(scene), BASE, which, "scene.toml") == getattr(scene.tables, which)


@pytest.mark.parametrize("saved, wanted", [("emit", "refl"), ("opac", "modu"), ("modu", "opac")])
def test_a_table_may_become_another_of_its_kind(saved: str, wanted: str) -> None:
    assert table_from_toml(table_toml(BASE, saved), BASE, wanted, "t.toml") == getattr(BASE.tables, saved)


@pytest.mark.parametrize(
    "text, which, told",
    [
        ("", "opac", "t.toml: holds no table of opacities to take"),
        ("[image]\nwidth = 5", "emit", "t.toml: holds no table of colours to take"),
        (table_toml(BASE, "opac"), "emit", "t.toml: holds no table of colours to take"),
        (table_toml(BASE, "opac") + table_toml(BASE, "modu"), "emit", "t.toml: holds no table of colours to take"),
        ("[tables.opac]\npoints = [[0, 2]]", "opac", "t.toml: tables.opac.*0 to 1"),
        ("[tables.opac]\npoint = [[0, 1]]", "opac", "t.toml: tables.opac.point: unknown key"),
        ("[tables.emit]\npoints = [[0, 'reddish']]", "emit", "t.toml: tables.emit.points.*'reddish' is not a colour"),
        ("tables = 1", "opac", "t.toml: tables: must be a table of keys"),
        ("[[", "opac", "t.toml: this is not TOML: Invalid"),
    ],
)
def test_what_holds_no_table_is_told_in_one_line(text: str, which: str, told: str) -> None:
    with pytest.raises(BadInput, match=told) as refused:
        table_from_toml(text, BASE, which, "t.toml")
    assert "\n" not in str(refused.value)


@given(text=st.text(), which=st.sampled_from(NAMES))
def test_any_text_gives_a_table_or_one_line(text: str, which: str) -> None:
    try:
        table_from_toml(text, BASE, which, "t.toml")
    except BadInput as error:
        assert str(error).startswith("t.toml:")
        assert "\n" not in str(error)
