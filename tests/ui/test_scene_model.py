"""The page's scene model: what is taken back, what is reported."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from volsplat.client.scene.presets import preset_scene
from volsplat.client.scene.resized import sized
from volsplat.client.ui.viewing.scene_model import SceneModel, SceneState
from volsplat.protocol.description.scene import Scene, Shading, View
from volsplat.protocol.description.shading_tables import ScalarTable


class Edit:
    def __init__(self, power: float) -> None:
        self.power = power

    def __call__(self, scene: Scene) -> Scene:
        return msgspec.structs.replace(scene, shading=Shading(specular_power=self.power))


def zoomed(zoom: float, scene: Scene) -> Scene:
    return msgspec.structs.replace(scene, view=View(zoom=zoom))


def model() -> SceneModel:
    return SceneModel(preset_scene("ct-skin"))


@given(st.lists(st.integers(1, 1000), max_size=12))
def test_undoing_everything_and_redoing_it_is_the_identity(powers: list[int]) -> None:
    scenes = model()
    first = scenes.scene
    for power in powers:
        scenes.change(Edit(power))
    last = scenes.scene
    while scenes.can_undo:
        scenes.undo()
    assert scenes.scene == first
    while scenes.can_redo:
        scenes.redo()
    assert scenes.scene == last


def test_a_drag_is_undone_as_one() -> None:
    scenes = model()
    first = scenes.scene
    for power in (2, 3, 4):
        scenes.change(Edit(power), settled=False)
    scenes.change(Edit(5))
    scenes.undo()
    assert scenes.scene == first
    assert not scenes.can_undo


def test_views_are_undone_like_all_else() -> None:
    scenes = model()
    first = scenes.scene
    scenes.change(Edit(7))
    scenes.change(lambda scene: zoomed(3.0, scene))
    scenes.undo()
    assert scenes.scene.view == first.view and scenes.scene.shading.specular_power == 7
    scenes.redo()
    assert scenes.scene.view.zoom == 3.0


def test_a_view_change_amid_a_drag_of_a_table_does_not_break_its_undo() -> None:
    scenes = model()
    scenes.change(Edit(2), settled=False)
    scenes.change(lambda scene: zoomed(3.0, scene), settled=False)
    scenes.change(Edit(4))
    scenes.undo()
    assert scenes.scene.shading == preset_scene("ct-skin").shading


def test_a_new_change_forgets_what_was_undone() -> None:
    scenes = model()
    scenes.change(Edit(2))
    scenes.undo()
    scenes.change(Edit(3))
    assert not scenes.can_redo


def test_a_refused_change_leaves_the_last_good_scene() -> None:
    scenes = model()
    told: list[SceneState] = []
    scenes.subscribe(told.append)
    before = scenes.now
    with pytest.raises(ValueError, match="specular_power"):
        scenes.change(Edit(-1))
    with pytest.raises(ValueError, match="opacity|value"):
        scenes.change(
            lambda scene: msgspec.structs.replace(
                scene, tables=msgspec.structs.replace(scene.tables, opac=ScalarTable(points=((0.0, 2.0),)))
            )
        )
    assert scenes.now is before and not told


def test_subscribers_hear_of_each_change_until_they_leave() -> None:
    scenes = model()
    told: list[SceneState] = []
    leave = scenes.subscribe(told.append)
    scenes.change(Edit(2), by="a tab", settled=False, event=4)
    leave()
    scenes.change(Edit(3))
    assert [(state.by, state.settled, state.events) for state in told] == [("a tab", False, {"a tab": 4})]
    assert scenes.now.events == {"a tab": 4}
    assert scenes.now.revision == told[0].revision + 1


def test_an_undo_amid_a_drag_takes_the_drag_back() -> None:
    scenes = model()
    scenes.change(Edit(2))
    scenes.change(Edit(3), settled=False)
    scenes.undo()
    assert scenes.scene.shading.specular_power == 2
    scenes.redo()
    assert scenes.scene.shading.specular_power == 3


def test_an_image_size_stays_through_undo_and_the_zoom_goes_with_it() -> None:
    scenes = model()
    scenes.change(lambda scene: zoomed(2.0, sized(scene, width=100, height=100)))
    scenes.change(Edit(2))
    scenes.change(lambda scene: sized(scene, width=300, height=200))
    scenes.undo()
    scene = scenes.scene
    assert (scene.image.width, scene.image.height, scene.view.zoom) == (300, 200, 4.0)
    assert scene.shading == preset_scene("ct-skin").shading


def test_a_size_alone_is_nothing_to_undo() -> None:
    scenes = model()
    scenes.change(lambda scene: sized(scene, width=33, height=44))
    assert not scenes.can_undo


def test_what_one_was_at_who_is_gone_is_settled_unless_another_one_holds_the_scene() -> None:
    scenes = model()
    scenes.let_go("nobody")
    assert scenes.now.revision == 1
    scenes.change(Edit(2), by="a", settled=False)
    scenes.resize(lambda scene: sized(scene, width=33, height=44), "b")  # another window's, amid the drag
    assert not scenes.now.settled and scenes.scene.image.width == 33
    scenes.let_go("b")
    assert not scenes.now.settled
    scenes.let_go("a")
    assert scenes.now.settled and scenes.scene.shading.specular_power == 2
    scenes.change(Edit(3), by="a", settled=False)
    scenes.change(Edit(4), by="b", settled=False)
    scenes.let_go("b")
    assert not scenes.now.settled
    scenes.let_go("a")
    assert scenes.now.settled
    settled = scenes.now
    scenes.let_go("a")
    assert scenes.now is settled


def test_who_let_go_is_not_let_go_once_more() -> None:
    scenes = model()
    scenes.change(Edit(2), by="a", settled=False)
    scenes.change(Edit(3), by="a")
    scenes.change(Edit(4), by="b", settled=False)
    scenes.let_go("a")
    assert not scenes.now.settled
