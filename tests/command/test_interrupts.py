"""Ctrl-C is not lost to whatever catches it while a library is imported."""

import signal
import subprocess
import sys
import threading
from pathlib import Path

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
from volsplat.client.caller.interrupts import at_abrupt_end, interrupts_held
at_abrupt_end(lambda: print("tidied", flush=True))
with interrupts_held():
    signal.raise_signal(signal.SIGINT)
    while True:  # an import without an end
        time.sleep(1)
"""


def test_who_ends_at_once_tidies_first() -> None:
    done = subprocess.run([sys.executable, "-c", ENDS_AT_ONCE], capture_output=True, encoding="utf-8", timeout=PATIENCE)
    assert (done.returncode, done.stdout) == (130, "tidied\n")


def test_a_command_that_becomes_a_program_is_interrupted_in_a_line(tmp_path: Path) -> None:
    """However early: as soon as the program has taken the command's place."""
    command = Person(tmp_path).starts("prepare", "missing.nrrd", "store.zarr")
    became = "-m\0volsplat.deploy.batch"
    wait_until(lambda: command.poll() is not None or became in Path(f"/proc/{command.pid}/cmdline").read_text(), became)
    command.send_signal(signal.SIGINT)
    _, said = command.communicate(timeout=PATIENCE)
    assert (command.returncode, said) == (130, "volsplat: interrupted\n")


STOPPED_AMID = """
import signal, sys
import numpy
from volsplat.client.session.published_image import PublishedImage

class Stops:  # who presses Ctrl-C when torch is half there
    def find_spec(self, name, path=None, target=None):
        if name == "torch.nn.modules" and self in sys.meta_path:
            sys.meta_path.remove(self)
            signal.raise_signal(signal.SIGINT)

sys.meta_path.insert(0, Stops())
image = PublishedImage.of(numpy.zeros((2, 3, 4)))
try:
    image.tensor
    print("done")
except KeyboardInterrupt:
    print("stopped", tuple(image.tensor.shape))
"""


def test_a_first_picture_that_is_stopped_leaves_torch_fit_for_the_next() -> None:
    done = subprocess.run([sys.executable, "-c", STOPPED_AMID], capture_output=True, encoding="utf-8", timeout=PATIENCE)
    assert (done.stdout, done.stderr) == ("stopped (2, 3, 4)\n", "")
