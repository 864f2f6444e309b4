"""The panels of the scene's keys: no key without a control, no control without a key."""

from volsplat.client.ui.controls.key_controls import MEANT_NUMBERS
from volsplat.client.ui.panels.scene_panels import CONTROLS, PANELS, place_of
from volsplat.protocol.description.scene_key import PartOf, Slide
from volsplat.protocol.description.scene_keys import KEYS

TABLES = PartOf("tables")  # which tables_panel.py builds


def test_every_key_is_in_one_panel() -> None:
    parts = [part for panel in PANELS for part in panel.sections]
    assert len(parts) == len(set(parts))
    assert {place_of(key) for key in KEYS.values() if key.widget != TABLES} == set(parts)


def test_every_control_that_a_key_names_is_there_and_nothing_else() -> None:
    named = {key.widget.control for key in KEYS.values() if isinstance(key.widget, PartOf) and key.widget != TABLES}
    assert named == set(CONTROLS)


def test_a_slider_has_limits_and_a_number_for_every_word() -> None:
    for key in KEYS.values():
        if isinstance(key.widget, Slide):
            assert key.told.limits is not None, key.place
            assert not key.declared.words or key.place in MEANT_NUMBERS, key.place
