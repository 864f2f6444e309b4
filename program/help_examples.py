"""The lines to type at the end of a command's help."""


def examples(*lines: str) -> str:
    """As click's epilog."""
    typed = "\n".join(f"  {line}" for line in lines)
    return f"\b\nExample{'s' * (len(lines) > 1)}:\n{typed}"
