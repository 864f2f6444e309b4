"""The package's doors: who may import whom, what lands in site-packages, what starts without torch."""

import os
import re
import subprocess
import sys
from collections import Counter
from fnmatch import fnmatch
from pathlib import Path

import pytest

from support.checkout import ROOT
from support.generated_docs import remade
from support.layout import (
    AT_LAST,
    BOTH_SERVERS,
    FLOORS,
    FRONT_DOOR,
    IMPURE,
    MAY_IMPORT,
    MOST_FILES,
    PARTS,
    PICTURES,
    PURE,
    SOURCES,
    floor_of,
    imported,
    imported_parts,
)


@pytest.mark.parametrize("part", PARTS)
def test_a_part_imports_only_what_its_door_opens_to(part: str) -> None:
    wrong = []
    for source in (source for source in SOURCES if source.parts[0] == part):
        servers = {"mapshade_server", "splat_server"} if source == BOTH_SERVERS else set()
        allowed = MAY_IMPORT[part] | {part} | servers
        wrong += [f"{source} -> {other}" for other in imported_parts(source) - allowed]
    assert wrong == []


@pytest.mark.parametrize("part", FLOORS)
def test_rooms_know_only_those_below_them(part: str) -> None:
    dotted = f"volsplat.{part.replace('/', '.')}."
    upward = []
    for source in (source for source in SOURCES if source.is_relative_to(part)):
        floor, room = floor_of(source, part)
        for name in imported(source):
            if f"{name}.".startswith(f"{dotted}_kernels."):  # which lie under all rooms
                continue
            if name.startswith(dotted):
                below, other = floor_of(Path(name.removeprefix("volsplat.").replace(".", "/")), part)
                if other != room and below >= floor and (source, other) not in AT_LAST:
                    upward.append(f"{source} -> {name}")
    assert upward == []


@pytest.mark.parametrize("part", FLOORS)
def test_every_room_has_its_floor(part: str) -> None:
    named = {room for rooms in FLOORS[part] for room in rooms.split()}
    folders = {source.parent.relative_to(part).as_posix() for source in SOURCES if source.is_relative_to(part)}
    assert folders <= named | {"."} and named <= folders


@pytest.mark.parametrize("room", PURE)
def test_what_is_pure_in_the_protocol_knows_no_sockets_and_no_processes(room: str) -> None:
    for source in (source for source in SOURCES if source.is_relative_to(Path("protocol", room))):
        assert not {name.split(".")[0] for name in imported(source)} & IMPURE, source


FILE_NAME = re.compile(r"(?<![\w./-])((?:[\w*]+/)*[\w*]+\.(?:py|pyi|cpp|h|js|css))\b")


def test_the_drawing_of_the_rooms_is_true() -> None:
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    assert remade(page, PICTURES) == page, "run in tests/: python -m support.layout ../CONTRIBUTING.md"


def test_no_folder_is_too_full_to_look_over() -> None:
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, encoding="utf-8", check=True).stdout
    count = Counter(Path(name).parent for name in listed.split())
    crowded = {folder for folder, files in count.items() if files > MOST_FILES}
    assert not {folder for folder in crowded if not folder.is_relative_to("tests/recorded")}


def test_the_benchmarks_are_named_by_the_command_table_alone() -> None:
    others = [source for source in SOURCES if source.parts[0] != "bench"]
    naming = [source for source in others if "volsplat.bench" in (ROOT / source).read_text(encoding="utf-8")]
    assert naming == [Path("client/command/commands.py")]


@pytest.mark.parametrize("part", PARTS)
def test_the_type_checkers_find_each_part_through_its_link(part: str) -> None:
    link = ROOT / "tests" / "typings" / "volsplat" / part
    assert link.is_symlink() and link.resolve() == ROOT / part
    assert (ROOT / part / "py.typed").exists()


def test_there_is_a_link_for_each_part_and_for_nothing_else() -> None:
    links = ROOT / "tests" / "typings" / "volsplat"
    assert {path.name for path in links.iterdir()} == {*PARTS, FRONT_DOOR.name}
    assert (links / FRONT_DOOR.name).resolve() == ROOT / FRONT_DOOR
    assert (ROOT / FRONT_DOOR).with_name("py.typed").exists()


def run_python(code: str, folder: Path) -> "subprocess.CompletedProcess[str]":
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run([sys.executable, "-c", code], cwd=folder, env=clean, capture_output=True, encoding="utf-8")


@pytest.mark.parametrize("part", PARTS)
def test_no_part_lands_at_the_top_of_site_packages(part: str, tmp_path: Path) -> None:
    assert run_python(f"import volsplat.{part}", tmp_path).returncode == 0
    assert "ModuleNotFoundError" in run_python(f"import {part}", tmp_path).stderr


@pytest.mark.parametrize(
    "module", ["volsplat.mapshade_server.server", "volsplat.splat_server.server", "volsplat.client.session.session"]
)
def test_servers_and_session_start_without_torch(module: str, tmp_path: Path) -> None:
    done = run_python(f"import sys, {module}; sys.exit('torch' in sys.modules)", tmp_path)
    assert done.returncode == 0, done.stderr


def test_the_front_door_loads_nothing_and_opens_to_every_name(tmp_path: Path) -> None:
    code = """
import sys, volsplat as vs
loaded = [name for name in sys.modules if name.startswith("volsplat.") or name in ("torch", "nicegui", "numpy")]
assert not loaded, loaded
assert all(getattr(vs, name) is not None for name in vs.__all__) and set(vs.__all__) <= set(dir(vs))
assert "torch" not in sys.modules and "nicegui" not in sys.modules
assert not hasattr(vs, "Sesion")
"""
    done = run_python(code, tmp_path)
    assert done.returncode == 0, done.stderr


def test_no_file_names_a_place_that_only_one_machine_has() -> None:
    tracked = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, encoding="utf-8", check=True
    ).stdout.split()
    forbidden = ("/wo" + "rk/", "/ro" + "ot/", "/ho" + "me/")
    for name in tracked:
        path = ROOT / name
        if path.is_file() and not path.is_symlink() and path.suffix in (".py", ".md", ".cpp", ".h", ".toml", ".txt"):
            text = path.read_text(encoding="utf-8")
            assert not any(word in text for word in forbidden), name


def test_the_docs_name_files_that_are_there() -> None:
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, encoding="utf-8", check=True).stdout
    files = listed.split()
    pages = [name for name in files if name.endswith(".md") and name != "CHANGELOG.md"]
    missing = [
        f"{page}: {name}"
        for page in pages
        for name in FILE_NAME.findall((ROOT / page).read_text(encoding="utf-8"))
        if not any(fnmatch(file, name) or fnmatch(file, f"*/{name}") for file in files)
    ]
    assert missing == []
