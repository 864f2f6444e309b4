"""What the helps of all commands have alike: how they are asked for, and the lines to type at their end."""

from typing import Any

HELP: dict[str, Any] = {"help_option_names": ["-h", "--help"]}  # of click's context


def examples(*lines: str) -> str:
    """As click's epilog."""
    typed = "\n".join(f"  {line}" for line in lines)
    return f"\b\nExample{'s' * (len(lines) > 1)}:\n{typed}"
