"""Options that are lists of numbers: 1,2,4."""

from volsplat.protocol.description.scene import LARGEST_EXTENT
from volsplat.protocol.text.errors import BadInput


def whole_numbers(option: str, text: str, least: int = 1, most: int = LARGEST_EXTENT) -> list[int]:
    """Different whole numbers. Raises BadInput."""
    parts = text.split(",")
    if not all(part.strip().isdecimal() and least <= int(part) <= most for part in parts):
        raise BadInput(f"{option} {text}: give whole numbers from {least} to {most}, as in 1,2,4")
    return list(dict.fromkeys(int(part) for part in parts))


def fractions(option: str, text: str, most: float = 1.0) -> list[float]:
    """Different numbers above 0 and at most `most`. Raises BadInput."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if not numbers or not all(0 < number <= most for number in numbers):
        raise BadInput(f"{option} {text}: give numbers above 0 and at most {most:g}, as in 0.25,0.5,1")
    return list(dict.fromkeys(numbers))
