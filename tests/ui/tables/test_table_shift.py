"""Tables under the axis of densities: pushed along it there and back, with undo between, and made for its window."""

from __future__ import annotations

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.pages.tables_page import SCENE, VOLUME
from volsplat.client.ui.tables.preset_menu import FROM_DATA, OfferedPresets
from volsplat.client.ui.tables.table_edits import shifted
from volsplat.client.ui.tables.table_shift import TableShift, by_density
from volsplat.client.ui.viewing.scene_model import SceneModel
from volsplat.protocol.description.scene import Quantise, Scene
from volsplat.protocol.description.shading_tables import ScalarTable

SHARES = st.integers(-255, 255).map(lambda steps: steps / 510)


@given(st.lists(st.lists(SHARES, min_size=1, max_size=4), max_size=5))
def test_pushes_that_add_up_to_nothing_change_nothing(pushes: list[list[float]]) -> None:
    shift, scene, total = TableShift(), SCENE, 0.0
    for way in pushes:
        for by in way:
            scene = shift.pushed(scene, by, settled=False)
        scene = shift.pushed(scene, way[-1], settled=True)
        total += way[-1]
    assert shift.pushed(scene, -total, settled=True) == SCENE


def test_a_push_goes_on_from_where_undo_has_led() -> None:
    shift, model = TableShift(), SceneModel(SCENE)
    for _ in range(2):
        model.change(lambda scene: shift.pushed(scene, 0.5, settled=True))
    model.undo()
    model.change(lambda scene: shift.pushed(scene, -0.5, settled=True))
    assert model.scene == SCENE


@pytest.mark.parametrize("which", ["tables", "cross_bar"])
def test_what_others_change_meanwhile_is_where_the_next_push_begins(which: str) -> None:
    def changed(scene: Scene) -> Scene:
        if which == "tables":
            other = ScalarTable(points=((0.25, 0.5), (0.75, 1.0)))
            return msgspec.structs.replace(scene, tables=msgspec.structs.replace(scene.tables, opac=other))
        by_strength = msgspec.structs.replace(scene.cross_bar, emit=scene.cross_bar.modu)
        return msgspec.structs.replace(scene, cross_bar=by_strength)

    shift = TableShift()
    scene = changed(shift.pushed(SCENE, 0.5, settled=True))
    pushed = shift.pushed(scene, -0.25, settled=True)
    for table in by_density(scene):
        assert getattr(pushed.tables, table) == shifted(getattr(scene.tables, table), -0.25)
    assert ("emit" in by_density(scene)) == (which == "tables")


def test_what_the_data_suggests_follows_the_window_as_presets_do() -> None:
    offered = OfferedPresets(VOLUME, first := VOLUME.default_scene())
    auto, narrow = first.quantise, Quantise(window=(-1000.0, 500.0))
    assert offered.scene(FROM_DATA, auto) == first
    for name, preset in ((FROM_DATA, None), ("ct-bone", "ct-bone")):
        tables = {quantise: offered.scene(name, quantise).tables for quantise in (auto, narrow)}
        assert tables[narrow] == VOLUME.begun_scene(preset, narrow).tables != tables[auto]
