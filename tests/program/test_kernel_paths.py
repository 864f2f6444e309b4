"""What the compilers hold kernels to: no table lacks one, and no instruction set's code is taken for another's."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from support.checkout import ROOT
from support.patience import PATIENCE

TABLE = "splat_server/kernels/paths/path_table.cpp"
SAME_BITS = "kernels/tests/same_bits.cpp"
MODULES = ("closed_tiles", "image_tiles", "index_rules", "packet_layout", "rounding")
NUMBERS = [f"protocol/rules/{name}.py" for name in MODULES]


def _compiles(source: Path, headers: Path) -> bool:
    compiler = shutil.which("c++")
    if compiler is None:
        pytest.skip("there is no C++ compiler")
    command = [compiler, "-std=c++20", "-fsyntax-only", "-DVOLSPLAT_PATH=baseline"]
    folders = [ROOT, (ROOT / TABLE).parent, headers]
    command += [*(f"-I{folder}" for folder in folders), str(source)]
    return subprocess.run(command, capture_output=True, timeout=PATIENCE).returncode == 0


@pytest.fixture
def headers(tmp_path: Path) -> Path:
    """The folder of the header that is made of numbers."""
    header = tmp_path / "kernels" / "constants.h"
    subprocess.run([sys.executable, "kernels/write_constants.py", str(header), *NUMBERS], cwd=ROOT, check=True)
    return tmp_path


def test_a_table_that_lacks_a_kernel_does_not_compile(headers: Path, tmp_path: Path) -> None:
    rows = (ROOT / TABLE).read_text(encoding="utf-8").splitlines(keepends=True)
    source = tmp_path / "path_table.cpp"
    source.write_text("".join(rows))
    assert _compiles(source, headers)
    lacking = [row for row in rows if ".fill_footprints" not in row]
    assert len(lacking) == len(rows) - 1
    source.write_text("".join(lacking))
    assert not _compiles(source, headers)


def test_what_compares_the_bits_of_two_processors_calls_the_kernels_as_they_are(headers: Path) -> None:
    assert _compiles(ROOT / SAME_BITS, headers)


def test_code_for_newer_processors_is_never_taken_for_all() -> None:
    """The linker keeps one copy of an inline function, perhaps one that this processor cannot run."""
    objects = sorted((ROOT / "build").glob("cp*/CMakeFiles/*_avx*.dir/**/*.o"))
    nm = shutil.which("nm")
    if not objects or nm is None:
        pytest.skip("the kernels were not compiled here for AVX, or there is no nm to read what was")
    found = subprocess.run(
        [nm, "--demangle", *map(str, objects)], capture_output=True, encoding="utf-8", check=True, timeout=PATIENCE
    )
    weak = [line for line in found.stdout.splitlines() if line[17:19] in ("W ", "V ", "u ")]
    assert [line for line in weak if "volsplat::avx" not in line] == []
