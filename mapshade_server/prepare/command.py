"""`volsplat prepare`: turns a volume into a packet store."""

import os
from contextlib import ExitStack
from pathlib import Path
from typing import Literal

import click

from volsplat.mapshade_server.prepare.prepare import Options, Prepared, prepare
from volsplat.mapshade_server.prepare.progress_bar import ProgressBar
from volsplat.program.command_lines import HELP, PATH, examples
from volsplat.program.plain_console import PlainConsole
from volsplat.program.task_pool import PoolOpener
from volsplat.protocol.text.byte_sizes import bytes_from_option
from volsplat.protocol.text.errors import BadInput


@click.command(
    "volsplat prepare",
    epilog=examples("volsplat prepare scan.nrrd scan.zarr --memory 4G"),
    context_settings=HELP,
)
@click.argument("volume")
@click.argument("out", metavar="OUT.zarr", type=PATH)
@click.option("--window", metavar="LOW,HIGH", help="Values that become density 0 and 255 (chosen from the data).")
@click.option("--directions", type=click.Choice(["octahedral", "paper"]), default="octahedral", help="(octahedral)")
@click.option("--memory", metavar="SIZE", default="1G", help="What the command may hold at a time (1G).")
@click.option("--verify/--no-verify", default=True, help="Read everything back at the end (yes).")
@click.option(
    "--cluster",
    type=PATH,
    help="Have the Dask workers of this cluster file do it, which all see VOLUME and OUT.zarr.",
)
@click.pass_obj
def prepare_command(
    open_pool: PoolOpener,
    volume: str,
    out: Path,
    window: str | None,
    directions: Literal["octahedral", "paper"],
    memory: str,
    verify: bool,
    cluster: Path | None,
) -> None:
    """Turn VOLUME, of any size, into a packet store that is drawn without being read whole.

    If it is interrupted, the same command continues from there.
    """
    options = Options(
        window=window_from_option(window) if window else None,
        directions=directions,
        memory=bytes_from_option("--memory", memory),
        verify=verify,
    )
    console = PlainConsole(stderr=True)
    try:
        with ExitStack() as open_now:
            pool = None if cluster is None else open_now.enter_context(open_pool(cluster, console.say))
            progress = open_now.enter_context(ProgressBar(console))
            prepared = prepare(volume, out, options, progress, pool)
    except OSError as error:
        reason = os.strerror(error.errno) if error.errno else str(error)
        raise BadInput(f"{out}: cannot be written ({reason}); see to it, then run the same command again") from None
    console.say(outcome(out, prepared))


def outcome(out: Path, prepared: Prepared) -> str:
    """One line of what became of it."""
    told = prepared.attributes
    size = " x ".join(str(n) for n in told.description.geometry.dims)
    low, high = told.quantisation.window
    what = f"{size} voxels, {len(told.levels)} level{'s' * (len(told.levels) > 1)}, window {low:g} to {high:g}"
    if prepared.seconds == 0:
        return f"{out}: was prepared before: {what}"
    rate = prepared.source_bytes / prepared.seconds / 1e6
    return f"{out}: {what}, in {prepared.seconds:.1f} s ({rate:.1f} MB/s of voxels)"


def window_from_option(text: str) -> tuple[float, float]:
    """Raises BadInput unless the text is LOW,HIGH of finite numbers, the first below the second."""
    try:
        low, high = (float(part) for part in text.split(","))
    except ValueError:
        raise BadInput(f"--window {text}: give two numbers LOW,HIGH, as in -1000,2000") from None
    if not -1e300 < low < high < 1e300:
        raise BadInput(f"--window {text}: LOW must be below HIGH")
    return low, high
