"""The client's disk fills up at random moments, under a seed: what becomes of the images that are written meanwhile.

    cd tests && ../.venv/bin/python -m faults.disk_runs --count 200 --seed 1 --write

prints a line for each time, and with --write puts the table into docs/how_it_works/reliability.md.
"""

import random
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import click
from faults.fault_runs import Head, drawn_head
from faults.fault_table import put

from support.files.small_disks import fill, mounted
from support.patience import PATIENCE
from volsplat.client import Session
from volsplat.client.image.image_file import write_image
from volsplat.protocol.text.errors import BadInput

KINDS = (".exr", ".png", ".tif", ".jpg")
SIZE = "4m"  # of the disk: an image, another one beside it while it is written, and little more
LONGEST_MOMENT = 0.3  # seconds into a run of frames when it fills up
FULL_SECONDS = 0.5
TABLE_HEAD = (
    "| image | times the disk filled up | images written whole | refused, the one before kept | damaged | hangs "
    "| median until the next image |\n|---|---|---|---|---|---|---|\n"
)


@dataclass
class Aftermath:
    """What became of images while the disk was full once."""

    kind: str
    whole: int = 0
    refused: int = 0
    damaged: int = 0
    hung: bool = False
    seconds: float = 0.0  # from when there is room again to the next image that is written

    def __str__(self) -> str:
        became = "HUNG" if self.hung else f"{self.seconds:.2f} s"
        return f"{self.kind}: {became}; {self.whole} whole, {self.refused} refused, {self.damaged} DAMAGED"


class Disk:
    """Holds the image, and is filled up and emptied again."""

    def __init__(self, folder: Path, session: Session, head: Head, chance: random.Random) -> None:
        self._folder, self._session, self._head, self._chance = folder, session, head, chance
        self._emptied_at = 0.0  # time.perf_counter(); 0 until it has been filled

    def fills_up(self, kind: str) -> Aftermath:
        """Draw and write on and on, fill the disk meanwhile, and go on until an image is written after that."""
        after, self._emptied_at = Aftermath(kind), 0.0
        path = self._folder / f"image{kind}"
        write_image(path, self._head.image, self._head.scene)
        expected = path.read_bytes()
        drawing = threading.Thread(target=self._write_on, args=(path, expected, after), daemon=True)
        filling = threading.Timer(self._chance.uniform(0, LONGEST_MOMENT), self._fill_for_a_while)
        drawing.start()
        filling.start()
        drawing.join(PATIENCE)
        after.hung = drawing.is_alive()
        filling.join()
        path.unlink()
        return after

    def _fill_for_a_while(self) -> None:
        fill(self._folder)
        time.sleep(FULL_SECONDS)
        (self._folder / "filler").unlink()
        self._emptied_at = time.perf_counter()

    def _write_on(self, path: Path, expected: bytes, after: Aftermath) -> None:
        while not after.seconds:
            begun = time.perf_counter()
            image = self._session.render(self._head.scene)
            try:
                write_image(path, image, self._head.scene)
                after.whole += 1
                if 0.0 < self._emptied_at < begun:
                    after.seconds = time.perf_counter() - self._emptied_at
            except BadInput as error:
                assert "No space left on device" in str(error) and "\n" not in str(error)
                after.refused += 1
            there = {one.name for one in self._folder.iterdir()} - {"filler"}
            after.damaged += path.read_bytes() != expected or there != {path.name}


def disk_runs(seed: int, goes_on: Callable[[int], bool], say: Callable[[str], None]) -> list[Aftermath]:
    chance, seen = random.Random(seed), list[Aftermath]()
    with drawn_head() as head, tempfile.TemporaryDirectory() as name, mounted(Path(name), SIZE) as folder:
        with Session(head.volume, workers=2) as session:
            disk = Disk(folder, session, head, chance)
            while goes_on(len(seen)):
                seen.append(disk.fills_up(chance.choice(KINDS)))
                say(f"{len(seen)}: {seen[-1]}")
                if seen[-1].hung:
                    break
    return seen


def table(seen: Sequence[Aftermath]) -> str:
    kinds = [(kind, [after for after in seen if after.kind == kind]) for kind in KINDS]
    return TABLE_HEAD + "".join(_row(kind, those) for kind, those in [*kinds, ("all", seen)])


def _row(kind: str, seen: Sequence[Aftermath]) -> str:
    seconds = [after.seconds for after in seen if not after.hung]
    figures = [
        len(seen),
        sum(after.whole for after in seen),
        sum(after.refused for after in seen),
        sum(after.damaged for after in seen),
        sum(after.hung for after in seen),
        f"{statistics.median(seconds):.2f} s" if seconds else "",
    ]
    return f"| {kind} | {' | '.join(map(str, figures))} |\n"


@click.command()
@click.option("--count", default=100, help="Times that it fills up (100).")
@click.option("--seed", type=int, help="What decides the moments (drawn, and printed).")
@click.option("--write", is_flag=True, help="Put the table into docs/how_it_works/reliability.md.")
def main(count: int, seed: int | None, write: bool) -> None:
    seed = random.randrange(1 << 30) if seed is None else seed
    print(f"seed {seed}", flush=True)
    seen = disk_runs(seed, lambda done: done < count, lambda line: print(line, flush=True))
    if write:
        put("full disks", f"`python -m faults.disk_runs --count {len(seen)} --seed {seed}`:\n\n{table(seen)}")
    sys.exit(any(after.damaged or after.hung for after in seen))


if __name__ == "__main__":
    main()
