"""`volsplat phantom`: writes a volume that volsplat makes itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from volsplat.client.command.choices import Words
from volsplat.client.command.help_page import helped, output_option
from volsplat.client.command.progress_bar import shown_progress
from volsplat.client.command.render_options import triple_from_option
from volsplat.client.command.side_console import SideConsole
from volsplat.client.phantoms import PHANTOMS, streamed_phantom
from volsplat.client.phantoms.volume_writer import check_voxels_apart, write_phantom
from volsplat.protocol.description.volume import Index
from volsplat.protocol.text.byte_sizes import size_on_disk
from volsplat.protocol.text.errors import BadInput

if TYPE_CHECKING:
    from torch import Tensor


LARGE = 1 << 30  # bytes

HELP = f"""Make the volume NAME and write it to a file.

NAME is one of {", ".join(sorted(PHANTOMS))}.

NRRD (.nrrd, .nhdr) is written while it is made, in little memory, whatever the size, and states what values and axes
are. Other formats take lengths for mm, and axes for a patient's.
"""


@helped("volsplat phantom head -o head.nrrd", "volsplat phantom shells -o shells.mha --size 256", text=HELP)
@click.argument("name", metavar="NAME", type=Words(sorted(PHANTOMS)))
@output_option(".nrrd, .nhdr, .mha, .mhd, .nii…")
@click.option("--size", metavar="N|IxJxK", help="Voxels along each axis, as 256 or 48x64x56.")
@click.option("--spacing", metavar="I,J,K", help="Distances between voxels, in the phantom's own unit.")
@click.option("--seed", type=click.IntRange(0, 2**63 - 1), default=0, help="Of the noise (0).")
def phantom(name: str, output: Path, size: str | None, spacing: str | None, seed: int) -> None:
    check_voxels_apart(output)
    made = streamed_phantom(
        name,
        size=size_of_grid(size) if size else None,
        spacing=triple_from_option("--spacing", spacing, float) if spacing else None,
        seed=seed,
    )
    ni, nj, nk = made.geometry.dims
    console = SideConsole()
    if (size_made := ni * nj * nk * made.dtype.itemsize) >= LARGE:
        console.say(f"makes {size_on_disk(size_made)} of voxels, which takes long; Ctrl-C ends it")
    with shown_progress(nk, console) as (tell, done):
        tell("making sheets")
        write_phantom(output, made._replace(sheets=_counted(made.sheets, done)))
    console.say(f"{output}: {name}, {ni} x {nj} x {nk} voxels")


def _counted(sheets: Iterator[Tensor], done: Callable[[int], None]) -> Iterator[Tensor]:
    """The sheets as they come; `done` gets the number of those that were made."""
    made = 0
    for some in sheets:
        yield some
        made += len(some)
        done(made)


def size_of_grid(text: str) -> Index:
    """Voxels along i, j, k from N, the same for all, or IxJxK. Raises BadInput."""
    sides = text.split("x")
    if len(sides) not in (1, 3) or not all(side.isdecimal() for side in sides):
        raise BadInput(f"--size {text}: give one number of voxels for all axes, or IxJxK, as in 48x64x56")
    i, j, k = (int(side) for side in (sides if len(sides) == 3 else sides * 3))
    return i, j, k
