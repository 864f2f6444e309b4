"""The page's own elements: each component's file is there, where NiceGUI looks without a word if it is not."""

import re
from pathlib import Path

import pytest

from support.checkout import ROOT

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
