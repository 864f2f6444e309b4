"""Imports done ahead: they are there when needed, and hold up nobody who does not need them."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest

from volsplat.client.command.import_ahead import imported_ahead

SLOW = "import time\ntime.sleep(0.3)\ndone = True\n"


@pytest.fixture
def modules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that modules are imported from."""
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def test_who_imports_what_is_under_way_gets_all_of_it(modules: Path) -> None:
    (modules / "slow_and_needed.py").write_text(SLOW)
    with imported_ahead("slow_and_needed"):
        import slow_and_needed  # type: ignore[import-not-found]

        assert slow_and_needed.done


def test_what_has_not_begun_at_the_end_is_left_out(modules: Path) -> None:
    (modules / "slow_first.py").write_text(SLOW.replace("0.3", "2"))
    (modules / "never_begun.py").write_text("")
    with imported_ahead("slow_first", "never_begun"):
        while "slow_first" not in sys.modules:
            time.sleep(0.001)
    assert sys.modules["slow_first"].done
    assert "never_begun" not in sys.modules


def test_a_module_that_is_not_there_is_told_to_who_needs_it_alone(tmp_path: Path) -> None:
    imported = "from volsplat.client.command.import_ahead import imported_ahead"
    program = f"{imported}\nwith imported_ahead('no_such_module'):\n    pass\n"
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert ran.stderr == ""


def test_what_an_import_raised_is_raised_for_whoever_waits_for_it(modules: Path) -> None:
    (modules / "there.py").write_text("")
    (modules / "broken.py").write_text("raise ImportError('lib.so: failed to map segment from shared object')")
    with imported_ahead("there", "broken", "never_begun_either") as awaited:
        with pytest.raises(ImportError, match="failed to map segment"):
            awaited("never_begun_either")
    assert "never_begun_either" not in sys.modules


def test_an_error_that_ends_the_block_waits_for_no_import(modules: Path) -> None:
    (modules / "slow_and_left.py").write_text(SLOW.replace("0.3", "3"))
    with pytest.raises(KeyboardInterrupt):
        with imported_ahead("slow_and_left"):
            while "slow_and_left" not in sys.modules:
                time.sleep(0.001)
            raise KeyboardInterrupt
    assert not hasattr(sys.modules["slow_and_left"], "done")
