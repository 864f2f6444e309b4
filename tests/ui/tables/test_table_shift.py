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
from volsplat.client.ui.viewing.known_pushes import KnownPushes
from volsplat.client.ui.viewing.scene_model import MOST_UNDONE, SceneModel
from volsplat.protocol.description.scene import Quantise, Scene
from volsplat.protocol.description.shading_tables import ScalarTable

SHARES = st.integers(-255, 255).map(lambda steps: steps / 510)


@given(st.lists(st.lists(SHARES, min_size=1, max_size=4), max_size=5))
def test_pushes_that_add_up_to_nothing_change_nothing(pushes: list[list[float]]) -> None:
    shift, scene, total = TableShift(KnownPushes()), SCENE, 0.0
    for way in pushes:
        for by in way:
            scene = shift.pushed(scene, by, settled=False)
        scene = shift.pushed(scene, way[-1], settled=True)
        total += way[-1]
    assert shift.pushed(scene, -total, settled=True) == SCENE


def test_a_push_goes_on_from_where_undo_has_led() -> None:
    shift, model = TableShift(KnownPushes()), SceneModel(SCENE)
    for _ in range(2):
        model.change(lambda scene: shift.pushed(scene, 0.5, settled=True))
    model.undo()
    model.change(lambda scene: shift.pushed(scene, -0.5, settled=True))
    assert model.scene == SCENE


def test_tabs_know_of_each_other_s_pushes_ended_or_left_under_way() -> None:
    for settled in (True, False):
        known = KnownPushes()
        first, second = TableShift(known), TableShift(known)
        gone = second.pushed(first.pushed(SCENE, 0.25, settled=False), 0.25, settled=True)
        far = first.pushed(first.pushed(gone, 0.1, settled=False), 0.5, settled=settled)
        assert TableShift(known).pushed(far, -1.0, settled=True) == SCENE
        assert second.pushed(gone, -0.5, settled=True) == SCENE


def test_no_more_pushes_are_known_than_can_be_undone() -> None:
    known, shift, scene = KnownPushes(), TableShift(KnownPushes()), SCENE
    made = [scene := shift.pushed(scene, 1 / 510, settled=True) for _ in range(MOST_UNDONE + 1)]
    for one in made:
        known.note((one.tables, ()), (SCENE.tables, 1.0), settled=True)
    assert known.begun((made[0].tables, ())) == (made[0].tables, 0.0)
    assert known.begun((made[1].tables, ())) == known.begun((made[-1].tables, ())) == (SCENE.tables, 1.0)


@pytest.mark.parametrize("which", ["tables", "cross_bar"])
def test_what_others_change_meanwhile_is_where_the_next_push_begins(which: str) -> None:
    def changed(scene: Scene) -> Scene:
        if which == "tables":
            other = ScalarTable(points=((0.25, 0.5), (0.75, 1.0)))
            return msgspec.structs.replace(scene, tables=msgspec.structs.replace(scene.tables, opac=other))
        by_strength = msgspec.structs.replace(scene.cross_bar, emit=scene.cross_bar.modu)
        return msgspec.structs.replace(scene, cross_bar=by_strength)

    shift = TableShift(KnownPushes())
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
