"""Faults of servers at random moments, under a seed: what becomes of the frames.

    cd tests && ../.venv/bin/python -m faults.fault_runs --count 500 --seed 1 --write [--box]

prints a line for each fault, and with --write puts the table into docs/how_it_works/reliability.md.
"""

import contextlib
import faulthandler
import math
import random
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

import click
import psutil
import pytest
import torch
from faults.fault_table import written
from faults.kinds_of_fault import Fault, HarmedServer
from faults.servers_at_hand import ServersAtHand
from faults.servers_in_box import HOSTS, ServersInBox

from support.files.head_volume import skin
from support.lab.box import box
from support.patience import PATIENCE
from volsplat.client import Session
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.session.renderer import Refinement
from volsplat.client.session.single import SingleProcess
from volsplat.deploy.server_command import Program
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Image, Scene
from volsplat.protocol.text.errors import VolsplatError

SIZE = (48, 56, 50)  # voxels
IMAGE = Image(width=320, height=280)
LONGEST_MOMENT = 0.3  # seconds into a run of frames when a fault comes: some frames long


@dataclass
class Aftermath:
    """What one fault did."""

    fault: Fault
    program: Program
    workers: int
    splat_servers: int
    whole: int = 0
    incomplete: int = 0
    wrong: int = 0
    hung: bool = False
    ended: str = ""  # why the session ended, if it did
    harmed_at: float = 0.0  # time.perf_counter()
    seconds: float = 0.0  # until the first frame that was asked for after the fault and is whole

    @property
    def only_one(self) -> bool:
        """Of its kind, so that the session may end before another one has come."""
        return (self.workers if self.program is Program.MAPSHADE_SERVER else self.splat_servers) == 1

    def finished(self, refinement: Refinement, truth: torch.Tensor) -> None:
        assert refinement.outcome is not None
        now = time.perf_counter()
        if refinement.outcome.servers.missing:
            self.incomplete += 1
        elif not torch.equal(refinement.image, truth):
            self.wrong += 1
        else:
            self.whole += 1
            if 0.0 < self.harmed_at < now - refinement.outcome.wall_seconds:
                self.seconds = self.seconds or now - self.harmed_at

    def __str__(self) -> str:
        told = f"{self.program.title} {self.fault.name}, {self.workers} + {self.splat_servers} servers"
        became = "HUNG" if self.hung else f"ended: {self.ended}" if self.ended else f"{self.seconds:.2f} s"
        return f"{told}: {became}; {self.whole} whole, {self.incomplete} incomplete, {self.wrong} WRONG"


class Head(NamedTuple):
    """A volume, a scene of it, and its image by the single process."""

    volume: Path
    scene: Scene
    image: torch.Tensor


class Servers(Protocol):
    """A session, and its servers, which can be harmed."""

    session: Session
    workers: int
    splat_servers: int

    @property
    def faults(self) -> Sequence[Fault]: ...
    @property
    def most_losses(self) -> int: ...  # of servers in one session
    @property
    def living(self) -> Sequence[HarmedServer]: ...
    def replace(self, number: int) -> None: ...
    def joined(self) -> bool: ...
    def close(self) -> None: ...


Opened = Callable[[Head, random.Random], Servers]  # a session anew, of a size by chance


class Bench:
    """A session of which one server after the other is harmed."""

    def __init__(self, head: Head, chance: random.Random, servers: Servers) -> None:
        self._head, self._random, self._servers = head, chance, servers
        self.session = servers.session
        self._healing: threading.Timer | None = None
        self._losses = 0
        self.session.render(head.scene)

    def close(self) -> None:
        if self._healing is not None:
            self._healing.join()
        self._servers.close()

    def suffers(self, fault: Fault, of: Collection[Program] = tuple(Program)) -> Aftermath:
        """Draw on and on, harm a server meanwhile, and draw until a frame that was begun after that is whole."""
        living = self._servers.living
        number = self._random.choice([n for n, server in enumerate(living) if server.program in of])
        after = Aftermath(fault, living[number].program, self._servers.workers, self._servers.splat_servers)
        moment = self._random.uniform(0, LONGEST_MOMENT)
        harm = threading.Timer(moment, lambda: self._harm(after, living[number], number))
        drawing = threading.Thread(target=self._draw, args=(after,), daemon=True)
        drawing.start()
        harm.start()
        drawing.join(PATIENCE)
        harm.join()
        if drawing.is_alive():
            after.hung = True
            faulthandler.dump_traceback()
        self._losses += fault.loses
        return after

    def random_fault(self) -> Fault:
        return self._random.choice(self._servers.faults)

    def processes(self, program: Program) -> list[psutil.Process]:
        return [server.process for server in self._servers.living if server.program is program]

    def goes_on(self) -> bool:
        """Whether all servers are there again, as they must be for the next fault."""
        if self._healing is not None:
            self._healing.join()
        until = time.monotonic() + PATIENCE
        while not self._servers.joined() and time.monotonic() < until:
            time.sleep(0.02)
        return self._servers.joined() and self._losses < self._servers.most_losses

    def _harm(self, after: Aftermath, harmed: HarmedServer, number: int) -> None:
        after.fault.harms(harmed)
        after.harmed_at = time.perf_counter()
        if after.fault.heals is None:
            self._servers.replace(number)
        else:
            self._healing = threading.Timer(after.fault.seconds, after.fault.heals, [harmed])
            self._healing.start()

    def _draw(self, after: Aftermath) -> None:
        try:
            while not after.seconds:
                for refinement in self.session.refine(self._head.scene, first=Step.F):
                    if refinement.outcome is not None:
                        after.finished(refinement, self._head.image)
        except VolsplatError as error:
            after.ended = str(error)


@contextlib.contextmanager
def drawn_head() -> Iterator[Head]:
    with tempfile.TemporaryDirectory() as folder:
        volume = Path(folder, "head.mha")
        write_volume(volume, *make_phantom("head", size=SIZE))
        with SingleProcess(volume) as single:
            scene = skin(single, IMAGE)
            image = single.render(scene)
        yield Head(volume, scene, image)


def at_hand(head: Head, chance: random.Random) -> Servers:
    return ServersAtHand(head.volume, chance, chance.randint(1, 4), chance.randint(1, 2))


@contextlib.contextmanager
def in_box() -> Iterator[Opened]:
    """Opens sessions in a lab of its own."""
    with tempfile.TemporaryDirectory() as name, pytest.MonkeyPatch.context() as changed:
        folder = Path(name)
        changed.setenv("XDG_STATE_HOME", str(folder / "state"))
        with box(folder, HOSTS) as lab:
            yield lambda head, chance: ServersInBox(lab, folder, head.volume, chance)


def fault_runs(
    seed: int,
    goes_on: Callable[[int], bool],
    say: Callable[[str], None],
    opened: Opened,
) -> list[Aftermath]:
    """Faults one after the other while it `goes_on`, given how many there were, in sessions of other sizes."""
    chance, seen = random.Random(seed), list[Aftermath]()
    with drawn_head() as head:
        bench: Bench | None = None
        try:
            while goes_on(len(seen)):
                bench = bench or Bench(head, chance, opened(head, chance))
                after = bench.suffers(bench.random_fault())
                seen.append(after)
                say(f"{len(seen)}: {after}")
                if after.ended or after.hung or chance.random() < 0.1 or not bench.goes_on():
                    bench.close()
                    bench = None
        finally:
            if bench is not None:
                bench.close()
    return seen


def summary(seen: list[Aftermath]) -> str:
    healed = [after.seconds for after in seen if after.fault.lasting and not after.ended and not after.hung]
    median = f", a median of {statistics.median(healed):.2f} s until the next whole frame" if healed else ""
    return (
        f"{len(seen)} faults: {sum(after.wrong for after in seen)} wrong images, "
        f"{sum(after.hung for after in seen)} hangs, {sum(bool(after.ended) for after in seen)} sessions ended{median}"
    )


@click.command()
@click.option("--count", default=100, help="Faults (100).")
@click.option("--minutes", type=float, default=math.inf, help="But no longer than this.")
@click.option("--seed", type=int, help="What decides them (drawn, and printed).")
@click.option("--box", "boxed", is_flag=True, help="In a lab in a box, by the launcher ssh (Linux, root).")
@click.option("--write", is_flag=True, help="Put the table into docs/how_it_works/reliability.md.")
def main(count: int, minutes: float, seed: int | None, boxed: bool, write: bool) -> None:
    seed = random.randrange(1 << 30) if seed is None else seed
    print(f"seed {seed}", flush=True)
    until = time.monotonic() + 60 * minutes
    with in_box() if boxed else contextlib.nullcontext(at_hand) as opened:
        seen = fault_runs(
            seed, lambda done: done < count and time.monotonic() < until, lambda line: print(line, flush=True), opened
        )
    print(summary(seen))
    if write:
        written(seen, seed, boxed)
    sys.exit(any(after.wrong or after.hung for after in seen))


if __name__ == "__main__":
    main()
