"""However images come, by memory that is shared, by sockets or by a slow link: they are the same."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from support.files.head_volume import head, single
from support.patience import PATIENCE
from volsplat.bench.slow_link import slow_link
from volsplat.client import Session
from volsplat.client.session.renderer import Refinement
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Image, Scene, View
from volsplat.protocol.wire.addresses import LOOPBACK, Address
from volsplat.protocol.wire.tokens import new_token

__all__ = ["head", "single"]

LEVEL = 1 / 255
SIDE = 200
KEPT = 10  # images: more than a shared memory has blocks

Relay = Callable[[int], AbstractContextManager[int]]
SLOW = partial(slow_link, bits_per_second=20e6, round_trip=0.02)
WAYS: dict[str, tuple[str, Relay]] = {
    "shared memory": (LOOPBACK, nullcontext),
    "sockets": ("127.0.0.2", nullcontext),  # no Unix socket stands beside that
    "a slow link": (LOOPBACK, SLOW),
}


@contextmanager
def joined(volume: str, host: str, relay: Relay) -> Iterator[Session]:
    """A session whose splat server calls through the relay."""
    token = new_token()
    programs: list[subprocess.Popen[bytes]] = []
    with Session(volume, workers=1, spawn=False, token=token, listen=Address(host, 0)) as session:
        with relay(session.address.port) as port:
            calls = {"volsplat.mapshade_server": session.address.port, "volsplat.splat_server": port}
            try:
                for module, at in calls.items():
                    command = [sys.executable, "-m", module, "--connect", f"{host}:{at}"]
                    programs.append(subprocess.Popen(command, env={"VOLSPLAT_TOKEN": token.key.decode()}))
                yield session
            finally:
                session.close()
                for program in programs:
                    program.wait(PATIENCE)


@pytest.fixture(scope="module", params=list(WAYS.values()), ids=list(WAYS))
def session(request: pytest.FixtureRequest, head: Path) -> Iterator[Session]:
    host, relay = request.param
    with joined(str(head), host, relay) as session:
        yield session


def seen(known: Session, turn: int) -> Scene:
    view = View(rotation=(0.3, 0.1 * turn, 0.2, 0.9), zoom=4.0)
    return msgspec.structs.replace(known.default_scene(), view=view, image=Image(width=SIDE, height=SIDE - 30))


def bits(image: Refinement) -> NDArray[np.uint32]:
    return image.published.pixels.view(np.uint32)


def test_finished_images_have_the_same_bits(session: Session, single: SingleProcess) -> None:
    for turn in range(2):
        for image in session.refine(seen(session, turn)):
            if image.complete:
                assert image.published.exact
                assert (bits(image) == bits(single.finish(seen(session, turn), image.step))).all()


def test_images_that_are_only_looked_at_look_the_same(session: Session, single: SingleProcess) -> None:
    for turn in range(3):
        scene = seen(session, turn)
        *_, image = session.refine(scene, Step.F, first=Step.F, exact=())
        assert image.complete
        drawn = single.finish(scene).published.pixels
        assert np.abs(image.published.pixels - drawn.clip(0, 1)).max() <= (0 if image.published.exact else LEVEL)
        finished = session.finish(scene)  # the same scene, bit for bit
        assert finished.published.exact and (finished.published.pixels == drawn).all()


def test_images_that_are_kept_stay_as_they_were(session: Session, single: SingleProcess) -> None:
    scenes = [seen(session, turn) for turn in range(KEPT)]
    kept = [session.finish(scene) for scene in scenes]
    for scene, image in zip(scenes, kept, strict=True):
        assert (bits(image) == bits(single.finish(scene))).all()


def test_the_report_tells_what_was_sent(session: Session) -> None:
    image = None
    for turn in range(2):
        *_, image = session.refine(seen(session, turn), Step.F, first=Step.F, exact=())
    assert image is not None and image.outcome is not None
    raw = SIDE * (SIDE - 30) * 16
    if not image.published.exact:
        assert 0 < image.outcome.image_bytes < raw / 4 and image.outcome.image_coding_seconds > 0
    else:
        assert image.outcome.image_bytes in (0, raw)


def test_by_a_slow_link_images_that_are_looked_at_come_coded(head: Path) -> None:
    with joined(str(head), LOOPBACK, SLOW) as session:
        *_, image = session.refine(seen(session, 0), Step.F, first=Step.F, exact=())
        assert not image.published.exact
        assert session.finish(seen(session, 0)).published.exact


def test_on_one_machine_no_byte_of_an_image_is_sent(head: Path) -> None:
    with Session(head, workers=1) as session:
        outcome = session.finish(seen(session, 0)).outcome
        assert outcome is not None and outcome.image_bytes == 0


def test_threads_that_ask_one_process_at_once_get_their_own_images(head: Path) -> None:
    """Scenes that are drawn from different packets, too."""
    with SingleProcess(head, threads=2) as shared:
        first = shared.volume.default_scene().with_(size=60)
        scenes = [first.with_(rotation=(40 * turn, 10), window=(0.0, 900.0 + turn % 2)) for turn in range(6)]
        expected = [bits(shared.finish(scene)) for scene in scenes]
        with ThreadPoolExecutor(len(scenes)) as threads:
            asked = [threads.submit(shared.finish, scene) for _ in range(3) for scene in scenes]
            for n, image in enumerate(asked):
                assert (bits(image.result(PATIENCE)) == expected[n % len(scenes)]).all()


def test_what_a_thread_reads_of_one_process_is_what_it_asked_for(head: Path) -> None:
    """Whatever others draw meanwhile, of other packets."""
    with SingleProcess(head, threads=1) as shared, ThreadPoolExecutor(1) as other:
        first = shared.volume.default_scene().with_(size=20)
        low, high = (first.with_(window=(0.0, end)) for end in (900.0, 1800.0))
        expected, found = shared.read_slice(low, "k", 8).tensor, shared.probe(low, 10, 10)
        often = sys.getswitchinterval()
        try:
            sys.setswitchinterval(1e-5)
            drawn = other.submit(lambda: [shared.finish(scene, Step.A) for _ in range(60) for scene in (low, high)])
            while not drawn.done():
                assert shared.read_slice(low, "k", 8).tensor.equal(expected)
                assert shared.probe(low, 10, 10) == found
        finally:
            sys.setswitchinterval(often)
        drawn.result()


def test_of_refinements_of_one_process_a_newer_one_ends_the_older_in_whatever_thread(head: Path) -> None:
    with SingleProcess(head, threads=2) as shared, ThreadPoolExecutor(1) as other:
        scene = shared.volume.default_scene().with_(size=1500)
        older = shared.refine(scene)
        assert next(older).step == Step.A
        rest = other.submit(list[Refinement], older)
        newer = list(shared.refine(scene.with_(size=40)))
        assert [image.step for image in newer if image.complete] == [step for step in Step if step <= Step.F]
        steps = [image.step for image in rest.result(PATIENCE)]  # as far as it came
        assert steps == sorted(steps)
        assert list(older) == []
