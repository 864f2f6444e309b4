"""What every benchmark can leave: tables on the terminal, and JSON, Markdown and a plot in files."""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Self, TypeVar

import click

from volsplat.bench.tables.plot import Panel, check_plot, write_plot
from volsplat.bench.tables.record import Record, write_record, write_text
from volsplat.bench.tables.text_table import TextTable
from volsplat.program.command_lines import PATH
from volsplat.program.plain_console import PlainConsole
from volsplat.protocol.description.machine import Machine
from volsplat.protocol.text.errors import BadInput

Command = TypeVar("Command", bound=Callable[..., Any])


@dataclass(frozen=True)
class Outputs:
    """The files that a person wants. None: not asked for."""

    json: Path | None = None
    markdown: Path | None = None
    plot: Path | None = None

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Self:
        """What `output_options` gave a command. Raises BadInput for a file that could not be written."""
        outputs = cls(given["json"], given["markdown"], given.get("plot"))
        if outputs.plot is not None:
            check_plot(outputs.plot)
        for path in (outputs.json, outputs.markdown, outputs.plot):
            if path is not None and (path.is_dir() or not os.access(path.parent, os.W_OK)):
                raise BadInput(f"{path}: cannot write this file; name another")
        return outputs

    def deliver(self, found: Record, tables: Sequence[TextTable], panels: Sequence[Panel] = ()) -> None:
        """Write the files and print the tables: what cannot be written takes nothing else with it.

        Raises BadInput for the first file that could not be, once all else is done.
        """
        refused: list[BadInput] = []
        for write in self._writers(found, tables, panels):
            try:
                write()
            except BadInput as error:
                refused.append(error)
        console = PlainConsole()
        for table in tables:
            console.print(*table.rich(console.width))
        for name, fact in found.facts.items():
            console.say(f"{name}: {fact}")
        if refused:
            raise refused[0]

    def _writers(
        self, found: Record, tables: Sequence[TextTable], panels: Sequence[Panel]
    ) -> Iterator[Callable[[], None]]:
        """What writes each file that is wanted."""
        machine = machine_words(found.machine)
        if self.json is not None:
            yield partial(write_record, self.json, found)
        if self.markdown is not None:
            facts = [f"- {name}: {fact}" for name, fact in {"machine": machine, **found.facts}.items()]
            text = "\n".join([*(table.markdown() for table in tables), *facts]) + "\n"
            yield partial(write_text, self.markdown, text)
        if self.plot is not None:
            yield partial(write_plot, self.plot, f"volsplat bench {found.command}\n{machine}", panels)


def output_options(plot: bool = False) -> Callable[[Command], Command]:
    """The options --json, --markdown and --plot; what they give `Outputs.of` reads."""

    def decorated(command: Command) -> Command:
        command = click.option("--json", type=PATH, help="Write the figures, for `volsplat bench compare`.")(command)
        command = click.option("--markdown", type=PATH, help="Write the tables as Markdown.")(command)
        return click.option("--plot", type=PATH, help="Draw the figures into a PNG file.")(command) if plot else command

    return decorated


def machine_words(machine: Machine) -> str:
    return f"{machine.cores} x {machine.cpu}, {machine.system}"
