"""`volsplat bench images`: what images cost on their way to the client while the volume turns."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import click

from volsplat.bench.subject import Subject, subject_options, volume_file, volume_words
from volsplat.bench.tables.outputs import Outputs, output_options
from volsplat.bench.tables.progress import shown_progress
from volsplat.bench.tables.record import Figure, figure, record
from volsplat.bench.tables.text_table import TextTable, significant
from volsplat.bench.views import ELEVATION, FIRST_AZIMUTH, seen
from volsplat.client.command.help_page import helped
from volsplat.client.command.side_console import SideConsole
from volsplat.client.session.links.image_decoder import ImageDecoder
from volsplat.client.session.published_image import PublishedImage
from volsplat.client.session.single import SingleProcess
from volsplat.program.this_machine import usable_cores
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import LARGEST_EXTENT, Scene
from volsplat.protocol.description.view_rotation import rotation_from_angles
from volsplat.protocol.messages.image_messages import RGBA_BYTES, ImageRead, RawPixels
from volsplat.splat_server.image_coder import ImageCoder

KINDS = {"8 bits": False, "exact": True}
LINKS = {"100 Mbit/s": 12.5e6, "1 Gbit/s": 125e6, "10 Gbit/s": 1.25e9}  # bytes a second


@helped("volsplat bench images --phantom shells:256")
@subject_options
@click.option("--images", "count", type=click.IntRange(min=2), default=12, help="One after the other (12).")
@click.option("--degrees", type=float, default=3.0, help="From one to the next (3).")
@click.option(
    "--image", "side", type=click.IntRange(16, LARGEST_EXTENT), default=1024, help="Side of the square image (1024)."
)
@output_options()
def images(count: int, degrees: float, side: int, **settings: Any) -> None:
    """Code and decode images of step F, each turned a little from the one before, and weigh them against links.

    Times are those that one core is busy. An image is coded, sent and decoded before the next one: nothing overlaps.
    """
    outputs = Outputs.of(settings)
    subject = Subject.of(settings)
    console = SideConsole()
    with console.status("starting") as status, volume_file(subject, status.update) as path:
        with SingleProcess(path, threads=usable_cores(), on_progress=status.update) as single:
            status.stop()
            shown = subject.scene_of(single.volume)
            drawn = _drawn(single, shown, count, degrees, side)
            volume = volume_words(single.volume)
    figures = {kind: _figures(kind, drawn, exact) for kind, exact in KINDS.items()}
    table = images_table(figures, f"{volume}, {side} x {side} pixels, turned by {degrees:g} degrees", count, side)
    outputs.deliver(record("images", {"volume": volume}, [one for of in figures.values() for one in of]), [table])


def _drawn(single: SingleProcess, shown: Scene, count: int, degrees: float, side: int) -> list[PublishedImage]:
    """So many images of the scene, each turned by so many degrees from the one before."""
    drawn = []
    with shown_progress("draw", count) as step:
        for n in range(count):
            rotation = rotation_from_angles(FIRST_AZIMUTH + degrees * n, ELEVATION)
            view = seen(shown, single.volume.description.geometry, rotation, (side, side))
            drawn.append(single.finish(view, Step.F).published)
            step()
    return drawn


def images_table(figures: Mapping[str, Sequence[Figure]], of: str, count: int, side: int) -> TextTable:
    """A row for each kind of image, whose figures are NAMES."""
    raw = side * side * RGBA_BYTES
    table = TextTable(
        f"Images of {of}",
        ("images", "MB", "code, ms", "decode, ms", *(f"a second by {link}" for link in LINKS)),
        f"Median of {count - 1} images. As they are, they have {raw / 1e6:.3g} MB: "
        + ", ".join(f"{rate / raw:.3g} a second by {link}" for link, rate in LINKS.items()),
    )
    for kind, (size, coding, decoding) in ((kind, [one.median for one in of]) for kind, of in figures.items()):
        rates = (1 / (coding + decoding + size / rate) for rate in LINKS.values())
        table.add(kind, *(significant(value) for value in (size / 1e6, coding * 1e3, decoding * 1e3, *rates)))
    return table


NAMES, UNITS = ("bytes", "coding", "decoding"), ("B", "s", "s")


def _figures(kind: str, drawn: Sequence[PublishedImage], exact: bool) -> list[Figure]:
    costs = list(_costs(drawn, exact))[1:]  # the first has none before it
    by_name = zip(NAMES, UNITS, zip(*costs, strict=True), strict=True)
    return [figure(f"{kind}: {name}", unit, samples) for name, unit, samples in by_name]


def _costs(drawn: Sequence[PublishedImage], exact: bool) -> Iterator[tuple[float, float, float]]:
    """Of each image: bytes, and seconds to code and to decode it."""
    coder, decoder = ImageCoder(), ImageDecoder()
    for published in drawn:
        image = ImageRead(1, Step.F, True, 0, 0, published.width, published.height, RawPixels())
        target = memoryview(bytearray(image.raw_bytes))
        began = time.thread_time()
        told, payload = coder.coded(image, memoryview(published.memory), exact)
        coded = time.thread_time()
        decoder.decode(image, told, memoryview(b"".join(payload)), target)
        yield told.bytes, coded - began, time.thread_time() - coded
