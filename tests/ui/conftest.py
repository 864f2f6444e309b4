"""The volume that most tests of the page view, by one command for all modules."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from support.pages.viewed import HEAD, KeptView, Viewed, written

_failed: list[str] = []  # tests of the page, also those that are tried once more


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    if report.outcome not in ("passed", "skipped"):
        _failed.append(report.nodeid)


@pytest.fixture(scope="session")
def volume(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("volume"), *HEAD)


@pytest.fixture(scope="session")
def kept_view(volume: Path) -> Iterator[KeptView]:
    with closing(KeptView(volume.parent, volume, "--workers", "2")) as kept:
        yield kept


@pytest.fixture
def view(kept_view: KeptView, request: pytest.FixtureRequest) -> Viewed:
    return kept_view.lent(request.path.name, len(_failed))
