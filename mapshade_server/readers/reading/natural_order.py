"""The order in which people look for names: by their numbers, whatever the case of their letters."""

import re

NameOrder = tuple[list[tuple[int, str]], str]


def natural_order(name: str) -> NameOrder:
    """To sort names by: step 10 comes after step 9."""
    words = re.split("0*([1-9][0-9]*|0)", name.casefold())  # every other one a number, of any length
    return [(len(word) if at % 2 else 0, word) for at, word in enumerate(words)], name
