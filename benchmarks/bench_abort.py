"""How long an abort takes to reach every server while a large frame runs.

    python benchmarks/bench_abort.py [--size 256] [--aborts 200] [--workers 2]

Prints the median, 95th percentile and greatest time from asking to the last server's acknowledgement, once for the
whole volume in view and once for a zoom at which a packet's footprint covers tens of thousands of pixels.
"""

import argparse
import math
import random
import statistics
import tempfile
import threading
import time
from pathlib import Path

import msgspec

from volsplat.client.frame_report import this_machine
from volsplat.client.phantoms import make_phantom, shells_tables
from volsplat.client.session import FrameAborted, Session
from volsplat.client.volume_writer import write_volume
from volsplat.protocol.scene import Image, Scene, View

GOAL_SECONDS = 0.050  # at the 95th percentile
HIGH_ZOOM = 64.0  # pixels a voxel


def abort_seconds(session: Session, scene: Scene, delay: float) -> float | None:
    """Seconds until an abort, asked for `delay` seconds into the frame, is acknowledged; None if it came too late."""
    aborted = threading.Event()

    def draw() -> None:
        try:
            session.render(scene)
        except FrameAborted:
            aborted.set()

    drawing = threading.Thread(target=draw)
    drawing.start()
    time.sleep(delay)
    asked = time.perf_counter()
    session.abort()
    drawing.join()
    return time.perf_counter() - asked if aborted.is_set() else None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--aborts", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    chance = random.Random(1)
    with tempfile.TemporaryDirectory() as folder:
        volume = Path(folder) / "shells.nrrd"
        write_volume(volume, *make_phantom("shells", size=(options.size,) * 3))
        with Session(volume, workers=options.workers) as session:
            print(f"{this_machine().cpu}, {options.size}^3 shells, 1024^2, {options.workers} map/shade servers")
            for title, view in (("the whole volume", View()), (f"zoom {HIGH_ZOOM:g}", View(zoom=HIGH_ZOOM))):
                scene = Scene(tables=shells_tables(), image=Image(width=1024, height=1024), view=view)
                print(f"{title}: {_told(session, scene, options.aborts, chance)}")


def _told(session: Session, scene: Scene, aborts: int, chance: random.Random) -> str:
    """Abort frames of a scene at random moments, seen from random sides."""
    session.render(scene)
    whole = min(_timed(session, scene) for _ in range(2))
    seconds: list[float] = []
    while len(seconds) < aborts:
        turned = msgspec.structs.replace(scene.view, rotation=tuple(chance.gauss(0, 1) for _ in range(4)))
        took = abort_seconds(session, msgspec.structs.replace(scene, view=turned), chance.uniform(0.05, 0.6) * whole)
        seconds += [took] if took is not None else []
    image = session.render(scene)
    assert image[..., 3].max() > 0, "after all aborts, a frame must still be drawn"
    seconds.sort()
    late = seconds[math.ceil(0.95 * len(seconds)) - 1]
    return (
        f"whole frame {whole * 1e3:.0f} ms; {len(seconds)} aborts at random moments of it, acknowledged by all: "
        f"median {statistics.median(seconds) * 1e3:.1f} ms, 95 % {late * 1e3:.1f} ms, "
        f"greatest {seconds[-1] * 1e3:.1f} ms; goal at 95 %: {GOAL_SECONDS * 1e3:.0f} ms"
    )


def _timed(session: Session, scene: Scene) -> float:
    began = time.perf_counter()
    session.render(scene)
    return time.perf_counter() - began


if __name__ == "__main__":
    main()
