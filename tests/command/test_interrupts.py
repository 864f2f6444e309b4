"""Ctrl-C is not lost to whatever catches it while a library is imported."""

import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from support.patience import PATIENCE, wait_until
from support.programs.programs import Person
from volsplat.client.caller.interrupts import interrupts_held


@pytest.fixture(autouse=True)
def pythons_own_handler() -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def test_an_interrupt_within_is_raised_at_the_end() -> None:
    went_on = False
    with pytest.raises(KeyboardInterrupt), interrupts_held():
        try:
            signal.raise_signal(signal.SIGINT)
            went_on = True
        except BaseException:
            pytest.fail("it was raised within, where anything may catch it")
    assert went_on
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_without_an_interrupt_nothing_happens() -> None:
    with interrupts_held():
        pass
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_an_error_within_comes_out_as_it_is() -> None:
    with pytest.raises(ImportError), interrupts_held():
        raise ImportError("broken")
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_other_threads_are_left_alone() -> None:
    caught: list[BaseException] = []

    def work() -> None:
        try:
            with interrupts_held():
                pass
        except BaseException as error:
            caught.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert not caught


def test_an_interrupt_outlives_an_error_within() -> None:
    with pytest.raises(KeyboardInterrupt), interrupts_held():
        signal.raise_signal(signal.SIGINT)
        raise ImportError("broken")


ENDS_AT_ONCE = """
import signal, time
from volsplat.client.caller.interrupts import at_abrupt_end, interrupts_held, process_is_a_commands
process_is_a_commands()
at_abrupt_end(lambda: print("tidied", flush=True))
with interrupts_held():
    signal.raise_signal(signal.SIGINT)
    while True:  # an import without an end
        time.sleep(1)
"""


def test_who_ends_at_once_tidies_first() -> None:
    done = subprocess.run([sys.executable, "-c", ENDS_AT_ONCE], capture_output=True, encoding="utf-8", timeout=PATIENCE)
    assert (done.returncode, done.stdout) == (130, "tidied\n")


GOES_ON = """
import signal, time
from volsplat.client.caller import interrupts
try:
    with interrupts.interrupts_held():
        signal.raise_signal(signal.SIGINT)
        time.sleep(1.5 * interrupts.LONGEST_IMPORT_SECONDS)
except KeyboardInterrupt:
    print("what was computed is still there")
"""


def test_a_script_is_interrupted_at_the_end_of_an_import_however_long() -> None:
    done = subprocess.run([sys.executable, "-c", GOES_ON], capture_output=True, encoding="utf-8", timeout=PATIENCE)
    assert (done.returncode, done.stdout) == (0, "what was computed is still there\n")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_export_ends_while_a_library_loads_for_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    modules = tmp_path / "modules"
    modules.mkdir()
    loading = tmp_path / "loading"
    endless = f"import pathlib, time\npathlib.Path({str(loading)!r}).touch()\ntime.sleep({2 * PATIENCE})\n"
    (modules / "skimage.py").write_text(endless)
    monkeypatch.setenv("PYTHONPATH", str(modules))
    np.save(tmp_path / "cube.npy", np.pad(np.full((2, 2, 2), 255, np.uint8), 2))
    command = Person(tmp_path).starts("export", "cube.npy", "-o", "cube.stl", "--level", "128")
    wait_until(lambda: loading.exists() or command.poll() is not None, "does it load")
    command.send_signal(number)
    _, said = command.communicate(timeout=PATIENCE)
    assert command.returncode == 128 + number, said


def test_a_command_that_becomes_a_program_is_interrupted_in_a_line(tmp_path: Path) -> None:
    """However early: as soon as the program has taken the command's place."""
    command = Person(tmp_path).starts("prepare", "missing.nrrd", "store.zarr")
    became = "-m\0volsplat.deploy.batch"
    wait_until(lambda: command.poll() is not None or became in Path(f"/proc/{command.pid}/cmdline").read_text(), became)
    command.send_signal(signal.SIGINT)
    _, said = command.communicate(timeout=PATIENCE)
    assert (command.returncode, said) == (130, "volsplat: interrupted\n")


STOPS = """
import signal, sys
import numpy

class Stops:  # who presses Ctrl-C when a library is half there
    def __init__(self, amid):
        self.amid = amid

    def find_spec(self, name, path=None, target=None):
        if name == self.amid and self in sys.meta_path:
            sys.meta_path.remove(self)
            signal.raise_signal(signal.SIGINT)

def stopped(amid, act):
    sys.meta_path.insert(0, Stops(amid))
    try:
        act()
        print("done")
    except KeyboardInterrupt:
        print("stopped", act())
"""

PICTURE = """
from volsplat.client.session.published_image import PublishedImage

image = PublishedImage.of(numpy.zeros((2, 3, 4)))
stopped("torch.nn.modules", lambda: tuple(image.tensor.shape))
"""

MESH = """
import volsplat as vs

values = numpy.zeros((6, 6, 6), numpy.uint8)
values[2:4, 2:4, 2:4] = 255
stopped("scipy.sparse", lambda: vs.export(vs.Volume(values, spacing=(1, 1, 1)), "cube.stl", level=128))
"""


@pytest.mark.parametrize(
    ("script", "made"), [(PICTURE, "(2, 3, 4)"), (MESH, "44 triangles at 128")], ids=["torch", "trimesh"]
)
def test_what_is_stopped_amid_its_library_leaves_it_fit_for_the_next(script: str, made: str, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", STOPS + script], cwd=tmp_path, capture_output=True, encoding="utf-8", timeout=PATIENCE
    )
    assert (done.stdout, done.stderr) == (f"stopped {made}\n", "")
