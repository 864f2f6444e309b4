"""Prints what some of volsplat's extras need, a requirement a line: pip by itself loads it only together with volsplat.

Standard library only: nothing is installed yet when this runs.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

PROJECT = Path(__file__).parent.parent / "pyproject.toml"
OWN_EXTRAS = re.compile(r"volsplat\[(.+)\]")


def libraries(extras: Sequence[str]) -> list[str]:
    """Those of volsplat itself as well."""
    project: dict[str, Any] = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    found = list(project["dependencies"])
    left, seen = list(extras), set(extras)
    while left:
        for requirement in project["optional-dependencies"][left.pop()]:
            own = OWN_EXTRAS.fullmatch(requirement)
            if own is None:
                found.append(requirement)
                continue
            named = set(own[1].split(",")) - seen
            seen |= named
            left += sorted(named)
    return sorted(set(found))


if __name__ == "__main__":
    print(*libraries(sys.argv[1:]), sep="\n")
