"""Libraries that are imported without looking for garbage among them."""

import gc
import subprocess
import sys

import pytest

from volsplat.program.many_imports import many_imports

# A library that reports at the end of the process what nothing has freed.
IMPORTING = "from volsplat.program.many_imports import many_imports\nwith many_imports(): import OpenImageIO"


def test_no_library_complains_at_the_end_of_the_process() -> None:
    ended = subprocess.run([sys.executable, "-c", IMPORTING], capture_output=True, text=True, check=True)
    assert (ended.stdout, ended.stderr) == ("", "")


@pytest.mark.parametrize("collected", [True, False])
def test_garbage_is_looked_for_afterwards_as_before(collected: bool) -> None:
    if not collected:
        gc.disable()
    try:
        with pytest.raises(ImportError), many_imports():
            assert not gc.isenabled()
            raise ImportError
        assert gc.isenabled() == collected and gc.get_freeze_count() > 0
    finally:
        gc.enable()
        gc.unfreeze()
