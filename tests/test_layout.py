"""The package's doors: who may import whom, what lands in site-packages, what starts without torch."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PARTS = ("protocol", "mapshade_server", "splat_server", "deploy", "client", "bench")

MAY_IMPORT = {
    "protocol": {"protocol"},
    "mapshade_server": {"mapshade_server", "protocol"},
    "splat_server": {"splat_server", "protocol"},
    "deploy": {"deploy", "protocol"},
    "client": {"client", "protocol", "deploy"},
    "bench": {"bench", "client", "protocol", "deploy", "mapshade_server", "splat_server"},  # and nobody imports it
}
BOTH_SERVERS = Path("client/single.py")  # the single process runs their very stages

SOURCES = [path.relative_to(ROOT) for part in PARTS for path in sorted((ROOT / part).rglob("*.py"))]


def imported_parts(source: Path) -> set[str]:
    tree = ast.parse((ROOT / source).read_text(encoding="utf-8"))
    names: list[str] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names += [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            assert not isinstance(node, ast.ImportFrom), f"{source} has a relative import"
    return {name.split(".")[1] for name in names if name.startswith("volsplat.")}


@pytest.mark.parametrize("source", SOURCES, ids=str)
def test_a_part_imports_only_what_its_door_opens_to(source: Path) -> None:
    allowed = MAY_IMPORT[source.parts[0]]
    if source == BOTH_SERVERS:
        allowed = allowed | {"mapshade_server", "splat_server"}
    assert imported_parts(source) <= allowed


def test_the_benchmarks_are_named_by_the_command_table_alone() -> None:
    others = [source for source in SOURCES if source.parts[0] != "bench"]
    naming = [source for source in others if "volsplat.bench" in (ROOT / source).read_text(encoding="utf-8")]
    assert naming == [Path("client/commands.py")]


@pytest.mark.parametrize("part", PARTS)
def test_the_type_checkers_find_each_part_through_its_link(part: str) -> None:
    link = ROOT / "tests" / "typings" / "volsplat" / part
    assert link.is_symlink() and link.resolve() == ROOT / part
    assert (ROOT / part / "py.typed").exists()


def test_there_is_a_link_for_each_part_and_for_nothing_else() -> None:
    assert {path.name for path in (ROOT / "tests" / "typings" / "volsplat").iterdir()} == set(PARTS)


def run_python(code: str, folder: Path) -> "subprocess.CompletedProcess[str]":
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run([sys.executable, "-c", code], cwd=folder, env=clean, capture_output=True, encoding="utf-8")


@pytest.mark.parametrize("part", PARTS)
def test_no_part_lands_at_the_top_of_site_packages(part: str, tmp_path: Path) -> None:
    assert run_python(f"import volsplat.{part}", tmp_path).returncode == 0
    assert "ModuleNotFoundError" in run_python(f"import {part}", tmp_path).stderr


@pytest.mark.parametrize(
    "module", ["volsplat.mapshade_server.server", "volsplat.splat_server.server", "volsplat.client.session"]
)
def test_servers_and_session_start_without_torch(module: str, tmp_path: Path) -> None:
    done = run_python(f"import sys, {module}; sys.exit('torch' in sys.modules)", tmp_path)
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
