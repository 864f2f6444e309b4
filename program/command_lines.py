"""What all command lines have alike: how help is asked for, the lines to type at its end, and times."""

from typing import Any

import click

HELP: dict[str, Any] = {"help_option_names": ["-h", "--help"]}  # of click's context
LONGEST_WAIT = 1e7  # seconds, 115 days: what clocks and sockets take


def examples(*lines: str) -> str:
    """As click's epilog."""
    typed = "\n".join(f"  {line}" for line in lines)
    return f"\b\nExample{'s' * (len(lines) > 1)}:\n{typed}"


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
