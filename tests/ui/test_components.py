"""The page's own elements: each component's file is there, where NiceGUI looks without a word if it is not."""

import re
from pathlib import Path

import pytest

from support.checkout import ROOT
from volsplat.client.ui.controls.text_field import shown_number

ELEMENTS = [
    (source.relative_to(ROOT), component)
    for source in sorted((ROOT / "client").rglob("*.py"))
    for component in re.findall(r'component="(\w+\.js)"', source.read_text(encoding="utf-8"))
]


@pytest.mark.parametrize(("source", "component"), ELEMENTS, ids=str)
def test_a_component_lies_beside_its_element(source: Path, component: str) -> None:
    assert (ROOT / source).with_name(component).exists()


def test_no_component_is_left_without_an_element() -> None:
    listed = {path.relative_to(ROOT) for path in (ROOT / "client").rglob("*_component.js")}
    assert listed == {source.with_name(component) for source, component in ELEMENTS} != set()


@pytest.mark.parametrize("typed", ["10000.3", "99999.5", "123456.75", "-1024", "0.1234567", "3e-07"])
def test_a_field_shows_a_number_as_it_was_typed(typed: str) -> None:
    assert shown_number(float(typed)) == typed


def test_a_field_shows_nothing_of_the_digits_that_a_float32_does_not_hold() -> None:
    assert shown_number(0.30000001192092896) == "0.3"
