"""What both languages know: the kernels were built with the protocol's numbers, and offer what their stubs say."""

import ast
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import volsplat.bench._kernels
import volsplat.client._kernels
import volsplat.mapshade_server._kernels
import volsplat.splat_server._kernels
from support.checkout import ROOT
from volsplat.protocol.rules import closed_tiles, image_tiles, index_rules, packet_layout, rounding

MODULES = [
    volsplat.mapshade_server._kernels,
    volsplat.splat_server._kernels,
    volsplat.client._kernels,
    volsplat.bench._kernels,
]
SHARED = [closed_tiles, image_tiles, index_rules, packet_layout, rounding]


@pytest.mark.parametrize("kernels", MODULES, ids=lambda module: module.__name__)
def test_kernels_were_built_with_the_numbers_of_the_protocol(kernels: ModuleType) -> None:
    named = {
        name: value
        for module in SHARED
        for name, value in vars(module).items()
        if name.isupper()
        and isinstance(value, int | float)
        and f"\n{name} = " in Path(module.__file__ or "").read_text(encoding="utf-8")
    }
    assert {"FROZEN_ALPHA", "TILE_SIDE", "NO_DATA_BIT", "ROW_RUN_BYTES", "OCTAHEDRAL_SIDE"} <= named.keys()
    assert kernels.constants() == named, "compile the kernels again: see CONTRIBUTING.md"


def test_the_bytes_of_a_row_run_are_those_of_its_struct() -> None:
    assert packet_layout.ROW_RUN.size == packet_layout.ROW_RUN_BYTES


def is_type(node: ast.FunctionDef | ast.ClassDef) -> bool:
    """Whether it only says what a function takes or gives."""
    bases = node.bases if isinstance(node, ast.ClassDef) else []
    return node.name == "Array" or any(isinstance(base, ast.Name) and base.id == "Protocol" for base in bases)


@pytest.mark.parametrize("kernels", MODULES, ids=lambda module: module.__name__)
def test_the_stub_names_what_the_module_offers(kernels: ModuleType) -> None:
    part = kernels.__name__.split(".")[1]
    stub = ast.parse((ROOT / part / "_kernels.pyi").read_text(encoding="utf-8"))
    named = {node.name for node in stub.body if isinstance(node, ast.FunctionDef | ast.ClassDef) and not is_type(node)}
    assert named == {name for name in dir(kernels) if not name.startswith("_")}


def test_numbers_become_a_header_that_is_left_alone_when_nothing_changes(tmp_path: Path) -> None:
    module, target = tmp_path / "numbers.py", tmp_path / "folder" / "numbers.h"
    module.write_text(
        "import struct\nFIRST_BIT = 3\nMASK = (1 << FIRST_BIT) - 1\nTHIRD = 1 / 3\nHALF = 0.5\nNAME = 'x'\n"
    )
    command = [sys.executable, str(ROOT / "kernels" / "write_constants.py"), str(target), str(module)]
    subprocess.run(command, check=True)
    text, written = target.read_text(encoding="utf-8"), target.stat().st_mtime_ns
    for line in ("int kFirstBit = 3;", "int kMask = 7;", f"double kThird = {1 / 3!r};", "float kHalf = 0.5f;"):
        assert f"constexpr {line}\n" in text
    assert "NAME" not in text
    subprocess.run(command, check=True)
    assert target.stat().st_mtime_ns == written
