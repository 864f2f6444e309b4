"""The package's rooms: which there are, who may know whom, and the drawing of them in CONTRIBUTING; in tests/:

python -m support.layout ../CONTRIBUTING.md
"""

import ast
import sys
from functools import cache
from pathlib import Path

from support.checkout import ROOT
from support.generated_docs import remake

MAY_IMPORT = {
    "protocol": set(),
    "program": {"protocol"},
    "mapshade_server": {"protocol", "program"},
    "splat_server": {"protocol", "program"},
    "deploy": {"protocol", "program"},
    "client": {"protocol", "program", "deploy"},
    "bench": {"client", "protocol", "program", "deploy", "mapshade_server", "splat_server"},  # and nobody imports it
}
PARTS = tuple(MAY_IMPORT)
FRONT_DOOR = Path("front/volsplat/__init__.py")  # what `import volsplat` offers; names rooms, and no room names it
BOTH_SERVERS = Path("client/session/single.py")  # the single process runs their very stages

FLOORS = {
    "protocol": ("text geometry", "description", "rules", "messages", "wire", "."),
    "mapshade_server": (
        "readers/reading links",
        "readers/arrays readers/astronomy readers/geology readers/molecules",
        "readers/vtk_files readers/medicine readers/zarr_arrays",
        "readers",
        "held",
        "frames",
        "answers",
        ".",
        "prepare",
    ),
    "client": (
        "files",
        "caller histogram phantoms trace",
        "image scene slices ui/doors memory",
        "volume",
        "coordinator/shares coordinator/events figure",
        "coordinator/holding",
        "coordinator",
        "session/links",
        "session",
        "movie gallery export",
        "ui/viewing",
        "ui/viewport ui/controls",
        "ui/panels/servers ui/panels ui/tables ui/opening",
        "ui",
        "script",
        "command .",
    ),
    "deploy": (".", "launchers", "tunnels", "cluster batch", "doctor"),
    "bench": ("tables", ".", "scaling peers floors hosts", "clusters quality", "commands"),
}
"""The rooms of a part from the ground up ("." is its own files): each knows only those on floors below it."""
AT_LAST = {(Path("client/session/session.py"), "ui")}  # who asks a session for its widget loads the page's modules
PURE = ("text", "geometry", "description", "rules", "messages")  # rooms of the protocol
IMPURE = {"socket", "select", "subprocess", "multiprocessing", "click", "rich"}
MOST_FILES = 25  # in a folder, so that a stranger can look over it

SOURCES = [path.relative_to(ROOT) for part in PARTS for path in sorted((ROOT / part).rglob("*.py"))]


@cache
def imported(source: Path) -> set[str]:
    """Everything that a module imports, wherever in it: dotted, without "volsplat." if it is ours."""
    names: set[str] = set()
    for node in ast.walk(ast.parse((ROOT / source).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{source} has a relative import"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def imported_parts(source: Path) -> set[str]:
    return {name.split(".")[1] for name in imported(source) if name.startswith("volsplat.")}


def floor_of(path: Path, part: str) -> tuple[int, str]:
    """The floor that a file or folder of a part is on, and its room there."""
    place = path.relative_to(part).as_posix()
    found = [
        (len(room), floor, room)
        for floor, rooms in enumerate(FLOORS[part])
        for room in rooms.split()
        if room == "." or place == room or place.startswith(f"{room}/")
    ]
    _, floor, room = max(found)
    return floor, room


def purpose(room: Path) -> str:
    """The first sentence of what a folder says of itself."""
    text = ast.get_docstring(ast.parse((ROOT / room / "__init__.py").read_text(encoding="utf-8"))) or ""
    return text.splitlines()[0]


def drawing() -> str:
    """The rooms, top floor first, each with its purpose; a part's line names the parts that it imports."""
    lines = []
    for part in reversed(PARTS):
        sources = [source for source in SOURCES if source.parts[0] == part]
        known = sorted(set().union(*map(imported_parts, sources)) - {part}, key=PARTS.index)
        lines += ["", f"{part}/  {purpose(Path(part))}", f"    knows {', '.join(known) or 'nothing of ours'}"]
        rooms = {source.parent for source in sources} - {Path(part)}
        top = Path(part)
        floors = {room: _height(room) for room in rooms}
        for room in sorted(rooms, key=lambda room: (-floors[room], room)):
            lines.append(f"    {room.relative_to(top).as_posix() + '/':<22} {purpose(room)}")
    return "\n".join(["```text", *lines[1:], "```"])


def _height(room: Path) -> int:
    """How high up a room is in its part, as FLOORS has it; 0 if that says nothing of it."""
    part = next((part for part in FLOORS if room.is_relative_to(part) and room != Path(part)), None)
    return floor_of(room, part)[0] if part else 0


PICTURES = {"layout": drawing}


if __name__ == "__main__":
    remake(map(Path, sys.argv[1:]), PICTURES)
