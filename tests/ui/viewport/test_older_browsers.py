"""What the page asks of browsers: nothing that Safari 17, where no test runs, has never heard of."""

from __future__ import annotations

import re

from support.checkout import ROOT

STATIC = ROOT / "client/ui/static"
# Names that Safari has had since 17.4 or later, or not at all.
LATE_NAMES = (
    "checkVisibility",
    "fromAsync",
    "getComposedRanges",
    "groupBy",
    "isWellFormed",
    "moveBefore",
    "requestIdleCallback",
    "scheduler",
    "setHTMLUnsafe",
    "withResolvers",
)
_RULE = re.compile(r"\{([^{}]*)\}")
_PREFIXED = re.compile(r"(?<!-)user-select: \w+")
_SPOKEN = re.compile(r'content: ("[^"]*") /')  # an icon, and what screen readers say in its place


def test_modules_name_nothing_that_safari_17_lacks() -> None:
    late = re.compile(rf"\b(?:{'|'.join(LATE_NAMES)})\b")
    modules = [*STATIC.rglob("*.js"), STATIC / "waiting.html", *(ROOT / "client/ui").rglob("*_component.js")]
    assert [(module.name, late.findall(text)) for module in modules if late.search(text := module.read_text())] == []


def test_styles_that_safari_17_does_not_know_stand_beside_one_that_it_does() -> None:
    rules = [body for sheet in sorted(STATIC.rglob("*.css")) for body in _RULE.findall(sheet.read_text())]
    prefixed = [(rule, found) for rule in rules for found in _PREFIXED.findall(rule)]
    spoken = [(rule, found) for rule in rules for found in _SPOKEN.findall(rule)]
    assert prefixed
    assert spoken
    assert [rule for rule, found in prefixed if f"-webkit-{found};" not in rule] == []
    assert [rule for rule, icon in spoken if f"content: {icon}; content: {icon} /" not in rule] == []
