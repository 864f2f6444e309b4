"""Million splats a second on one core, for each footprint size, CPU path and order, beside a bare loop.

Run it as `python benchmarks/bench_splat.py`. The bare loop (bare_splat.cpp) is compiled for the same instruction
set; the ratio says what packets, offsets, rows and clipping cost. Every timing also checks the image it made.
"""

import ctypes
import functools
import math
import os
import platform
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import torch

from volsplat.protocol.footprint_shape import footprint_shape
from volsplat.protocol.frame_plan import plan_frame
from volsplat.protocol.packet_layout import COLOUR_SHIFT, OPACITY_SHIFT, POSITION_BITS, ROW_RUN, opacity_of_code
from volsplat.protocol.scene import TRAVERSAL_ORDERS, ColourTable, Image, Order, ScalarTable, Scene, Step, Tables, View
from volsplat.protocol.volume import Geometry
from volsplat.splat_server import _kernels
from volsplat.splat_server.footprint_table import footprint_table
from volsplat.splat_server.image_buffer import ImageBuffer

SIZE = 512  # pixels
SPLATS = 1_000_000
REPEATS = 5
OPACITY_CODE = 1500
COLOUR = (200, 100, 50)
WITHIN = 0.1  # relative, of the block's opacity: sheets' weights w A vary over a pixel
FLAGS = {"baseline": (16, []), "avx2": (32, ["-mavx2"]), "avx512": (64, ["-mavx512f", "-mprefer-vector-width=512"])}


def view(zoom: float) -> Scene:
    plain = ScalarTable(points=((0.0, 1.0),))
    tables = Tables(
        emit=ColourTable(points=((0.0, (1.0, 1.0, 1.0)),)), refl=ColourTable(points=((0.0, (0, 0, 0)),)), opac=plain
    )
    rotation = (0.1, 0.06, 0.05, 1.0)
    return Scene(tables=tables, view=View(rotation=rotation, zoom=zoom), image=Image(width=SIZE, height=SIZE))


def sheets(scene: Scene) -> tuple[bytes, torch.Tensor, tuple[int, int, int]]:
    """Row runs, packets and counts of whole sheets that cover the middle of the image."""
    side = int(SIZE * 0.6 / float(scene.view.zoom))
    deep = max(1, SPLATS // side**2)
    plan = plan_frame(scene, Geometry((side, side, deep)), Step.F)
    along_row = min(side, int(200 / float(scene.view.zoom)))
    runs, packets = [], []
    sample = torch.arange(side)
    for sheet in range(deep):
        for row in range(side):
            x, y = (
                (
                    dda.origin
                    + 2 * (sample * dda.half_steps[0] + row * dda.half_steps[1] + sheet * dda.half_steps[2])
                    + (1 << 25)
                )
                >> 26
                for dda in (plan.x, plan.y)
            )
            for first in range(0, side, along_row):
                px, py = x[first : first + along_row], y[first : first + along_row]
                x0, y0 = int(px.min()), int(py.min())
                runs.append(ROW_RUN.pack(sheet, row, first, len(px), x0, y0))
                packets.append(px - x0 | py - y0 << POSITION_BITS)
    colour = (COLOUR[0] | COLOUR[1] << 8 | COLOUR[2] << 16) << COLOUR_SHIFT | OPACITY_CODE << OPACITY_SHIFT
    return b"".join(runs), torch.cat(packets) | colour, (deep, side, side)


def best_seconds(work: Callable[[], object]) -> float:
    """The shortest of some repeats."""
    best = math.inf
    for _ in range(REPEATS):
        begin = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - begin)
    return best


def bare_loop(path: str, folder: Path) -> ctypes.CDLL:
    vector_bytes, flags = FLAGS[path]
    library = folder / f"bare_{path}.so"
    source = Path(__file__).with_name("bare_splat.cpp")
    compiler = os.environ.get("CXX", "c++")
    command = [compiler, "-O3", "-std=c++20", "-shared", "-fPIC", "-ffp-contract=off", "-Wno-psabi", *flags]
    subprocess.run([*command, f"-DVECTOR_BYTES={vector_bytes}", str(source), "-o", str(library)], check=True)
    return ctypes.CDLL(str(library))


def bare_seconds(library: ctypes.CDLL, side: int, packets: int) -> float:
    """The same number of boxes, one after the other along rows, two pixels apart."""
    pitch = SIZE + 20
    image = torch.zeros(SIZE * pitch * 4 + 16)
    across = (SIZE - 2 * side) // 2
    n = torch.arange(packets)
    corners = torch.stack((n % across * 2, n // across * 2 % (SIZE - side)), dim=1).int().contiguous()
    weights = torch.full((side * side * 4,), 0.01)
    sample = torch.tensor([*(channel / 255 for channel in COLOUR), 1.0])
    pointers = [ctypes.c_void_p(tensor.data_ptr()) for tensor in (image, corners, weights, sample)]

    def work() -> None:
        library.bare_splat(
            pointers[0], ctypes.c_int64(pitch), pointers[1], ctypes.c_int64(packets), side, pointers[2], pointers[3]
        )

    seconds = best_seconds(work)
    assert image.max() <= 1 and image.reshape(-1)[3::4].max() > 0
    return seconds


def check(image: memoryview, sheets: int) -> None:
    """In the middle of the block every pixel has the opacity of this many sheets, one reference spacing each."""
    middle = slice(SIZE // 2 - 20, SIZE // 2 + 20)
    alpha = torch.frombuffer(image, dtype=torch.float32).reshape(SIZE, SIZE, 4)[middle, middle, 3]
    expected = 1 - math.exp(-sheets * opacity_of_code(OPACITY_CODE))
    assert float((alpha / expected - 1).abs().max()) < WITHIN, "the block has the wrong opacity"


def measure(side: int, folder: Path) -> None:
    """Print a line for each path at `side` x `side` pixels."""
    scene = view(zoom=side / 4)
    runs, packets, counts = sheets(scene)
    memory = _kernels.BatchMemory(runs, packets)
    buffers = _kernels.SortedBuffers(1, *counts)
    buffers.push(0, 0, memory, 0, 0, True)
    spans = buffers.advance(1 << 62)[0]
    plan = plan_frame(scene, Geometry((8, 8, 8)), Step.F)
    table = footprint_table(footprint_shape(plan, scene.reconstruction))
    assert (table.width, table.height) == (side, side)
    image = ImageBuffer(SIZE, SIZE)
    for path in _kernels.cpu_paths():
        _kernels.set_cpu_path(path)
        rates = []
        for order in TRAVERSAL_ORDERS:
            image.clear()
            image.splat(spans, table, order)
            if order == Order.BACK_TO_FRONT:
                check(image.snapshot(), counts[0])
            seconds = best_seconds(functools.partial(image.splat, spans, table, order))
            rates.append(spans.packets / seconds / 1e6)
        bare = spans.packets / bare_seconds(bare_loop(path, folder), side, spans.packets) / 1e6
        figures = " ".join(f"{rate:7.1f}" for rate in (*rates, bare))
        print(f"{f'{side}x{side}':>8} {path:>9} {figures} {rates[0] / bare:9.2f}")


def main() -> None:
    print(f"{platform.processor() or platform.machine()}, {SIZE} x {SIZE} pixels, million splats/s on one core")
    print(f"{'pixels':>8} {'path':>9} {'btf':>7} {'ftb':>7} {'bare':>7} {'btf/bare':>9}")
    with tempfile.TemporaryDirectory() as folder:
        for side in (4, 8, 12, 16):
            measure(side, Path(folder))


if __name__ == "__main__":
    main()
