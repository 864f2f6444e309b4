"""`volsplat bench`: the group of the benchmarks, each imported only when it is called."""

from importlib import import_module

import click

from volsplat.client.caller.interrupts import interrupts_held
from volsplat.protocol.text.meant import meant

SUMMARIES = {
    "paper": "The paper's timing table beside this machine's.",
    "scaling": "How a frame's time grows with voxels, pixels and servers, and what limits it.",
    "hosts": "Splat servers on hosts of their own, over links of a given rate.",
    "links": "What a link carries, by each way that links go, and what TLS costs.",
    "kernels": "Voxels, splats and pixels a second on one core, beside the machine's floors.",
    "peers": "volsplat and VTK's CPU ray caster draw the same pictures.",
    "quality": "How good the pictures are: against rays cast in float64, from many sides, beside what they cost.",
    "images": "What images cost on their way to the client, in bytes and milliseconds.",
    "aborts": "How long an abort takes to reach every server.",
    "page": "How soon the page follows the hand, in a real browser.",
    "compare": "What moved between two records.",
}


class Benchmarks(click.Group):
    """Finds sub-commands in SUMMARIES, and lists them without importing any."""

    def list_commands(self, context: click.Context) -> list[str]:
        return list(SUMMARIES)

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        if name not in SUMMARIES:
            raise click.UsageError(f"there is no benchmark {name!r} ({meant(name, list(SUMMARIES))})", context)
        with interrupts_held():
            command: click.Command = getattr(import_module(f"volsplat.bench.commands.{name}_command"), name)
        return command

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(SUMMARIES.items()))


@click.group(cls=Benchmarks)
def bench() -> None:
    """Measure volsplat: against its paper, the machine's floors, its peers, and an earlier run of itself."""
