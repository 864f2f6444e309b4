"""What all command lines have alike: how help is asked for, the lines to type at its end, files, and times."""

from pathlib import Path
from typing import Any

import click

from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.file_names import is_file_url, path_of, scheme_of

HELP: dict[str, Any] = {"help_option_names": ["-h", "--help"]}  # of click's context
LONGEST_WAIT = 1e7  # seconds, 115 days: what clocks and sockets take


def examples(*lines: str) -> str:
    """As click's epilog."""
    typed = "\n".join(f"  {line}" for line in lines)
    return f"\b\nExample{'s' * (len(lines) > 1)}:\n{typed}"


class _LocalPath(click.Path):
    """A file or folder of this machine, by its path or its file:// URL."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Raises BadInput for a URL of anything else, which would be taken for a folder's name."""
        if isinstance(value, str):
            if scheme_of(value) and not is_file_url(value):
                raise BadInput(f"{value}: is a URL, and what is meant must be a file or folder here; give its path")
            value = path_of(value)
        return super().convert(value, param, ctx)


PATH = _LocalPath()


class Seconds(click.FloatRange):
    """A time within a range, in which nan lies nowhere."""

    name = "seconds"

    def __init__(self, least: float, most: float = LONGEST_WAIT, *, least_open: bool = False) -> None:
        super().__init__(least, most, min_open=least_open)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        seconds: float = super().convert(value, param, ctx)
        if seconds != seconds:
            self.fail(f"{value} is not in the range {self._describe_range()}.", param, ctx)
        return seconds
