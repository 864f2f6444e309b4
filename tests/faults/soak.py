"""A person who turns a volume and changes its tables for long, while a server is killed now and then.

    cd tests && ../.venv/bin/python -m faults.soak --minutes 30

prints what the processes that live all the time hold, and fails where that grows.
"""

import random
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import click
import msgspec
import psutil
from faults.fault_runs import Bench, drawn_head
from faults.kinds_of_fault import FAULTS
from faults.servers_at_hand import ServersAtHand

from volsplat.deploy.server_command import Program
from volsplat.protocol.description.scene import Scene

KILLED = FAULTS[0]
GROWTH = 64 << 20  # bytes that a process may hold more at the end than after its first quarter
MORE_FILES = 8  # and open files: one or two connections are under way at any time


@dataclass(frozen=True)
class Held:
    """What the client and the splat servers hold."""

    memory: tuple[int, ...]  # bytes
    files: tuple[int, ...]

    def __str__(self) -> str:
        return ", ".join(f"{n >> 20} MiB and {m} files" for n, m in zip(self.memory, self.files, strict=True))

    def grown(self, since: "Held") -> bool:
        more = (now - before for now, before in zip(self.memory, since.memory, strict=True))
        files = (now - before for now, before in zip(self.files, since.files, strict=True))
        return max(more) > GROWTH or max(files) > MORE_FILES


def held(bench: Bench) -> Held:
    lasting = [psutil.Process(), *bench.processes(Program.SPLAT_SERVER)]
    return Held(tuple(one.memory_info().rss for one in lasting), tuple(one.num_fds() for one in lasting))


def turned(scene: Scene, chance: random.Random) -> Scene:
    """From another side, with other opacities."""
    turn = [chance.gauss(0, 1) for _ in range(4)]
    length = sum(part * part for part in turn) ** 0.5
    x, y, z, w = (part / length for part in turn)
    view = msgspec.structs.replace(scene.view, rotation=(x, y, z, w))
    opacities = tuple((at, opacity * chance.uniform(0.2, 1.0)) for at, opacity in scene.tables.opac.points)
    opac = msgspec.structs.replace(scene.tables.opac, points=opacities)
    return msgspec.structs.replace(scene, view=view, tables=msgspec.structs.replace(scene.tables, opac=opac))


def soak(seed: int, seconds: float, kill_every: float, say: Callable[[str], None]) -> tuple[Held, Held]:
    """What is held after a quarter of the time, and at the end."""
    chance = random.Random(seed)
    began = killed = time.monotonic()
    early: Held | None = None
    frames = kills = 0
    with drawn_head() as head:
        bench = Bench(head, chance, ServersAtHand(head.volume, chance, workers=2, splat_servers=1))
        try:
            while (now := time.monotonic()) - began < seconds:
                bench.session.render(turned(head.scene, chance))
                frames += 1
                if early is None and now - began > seconds / 4:
                    early = held(bench)
                    say(f"after {frames} frames, {kills} kills: {early}")
                if now - killed > kill_every:
                    after = bench.suffers(KILLED, of=[Program.MAPSHADE_SERVER])
                    assert after.seconds and not after.wrong, after
                    assert bench.goes_on(), "no server took the place of the one that was killed"
                    killed, kills = now, kills + 1
            late = held(bench)
            say(f"after {frames} frames, {kills} kills: {late}")
        finally:
            bench.close()
    assert early is not None
    return early, late


@click.command()
@click.option("--minutes", default=30.0, help="How long (30).")
@click.option("--kill-every", default=60.0, help="Seconds between two kills (60).")
@click.option("--seed", type=int, help="What decides them (drawn, and printed).")
def main(minutes: float, kill_every: float, seed: int | None) -> None:
    seed = random.randrange(1 << 30) if seed is None else seed
    print(f"seed {seed}", flush=True)
    early, late = soak(seed, 60 * minutes, kill_every, lambda line: print(line, flush=True))
    sys.exit(late.grown(early))


if __name__ == "__main__":
    main()
