"""What pyproject.toml declares: each library that a part imports, in the extra that the part may use, and no more."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from support.checkout import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
ALWAYS = "always"  # what is installed without any extra

MAY_USE = {
    "protocol": {"msgspec", "cryptography"},
    "program": {"click", "rich", "metrics"},
    "deploy": {"msgspec"},
    "deploy/launchers/dask.py": {"msgspec", "dask"},
    "deploy/launchers/dask_task.py": {"dask"},
    "deploy/batch/dask_pool.py": {"dask"},
    "deploy/batch/dask_tasks.py": {"dask"},
    "deploy/batch/dask_workers.py": {"dask"},
    "deploy/batch/task_run.py": {"dask"},
    "splat_server": {"click", "zstandard"},
    "mapshade_server": {ALWAYS, "formats"},
    "client": {ALWAYS},
    "client/caller/whole_torch.py": {ALWAYS, "torch"},
    "client/export/mesh.py": {ALWAYS, "export"},
    "client/figure/pdf_file.py": {ALWAYS, "pdf", "pillow"},  # which reportlab brings
    "client/memory/known_arrays.py": {
        ALWAYS,
        "itk",
        "nibabel",
        "vtk",
    },  # of an image that is theirs, so that they are there
    "client/phantoms": {ALWAYS, "torch"},
    "client/scene/colour_maps.py": {ALWAYS, "matplotlib"},
    "client/script/rendered_image.py": {ALWAYS, "ui"},
    "client/session/published_image.py": {ALWAYS, "torch"},  # a tensor for whoever asks for one
    "client/slices/volume_slice.py": {ALWAYS, "torch"},  # likewise
    "client/ui": {ALWAYS, "ui"},
    "client/ui/lean_nicegui.py": {ALWAYS, "ui", "pydantic"},  # which fastapi brings
    "client/ui/notebook_widget.py": {ALWAYS, "notebook"},
    "bench": {ALWAYS, "bench", "torch"},
}
"""Which libraries a place may import, by their names or those of extras. The closest place counts."""
BESIDE = {"docs", "dev", "build", "fuzz"}  # extras for work on volsplat, which it does not import
DISTRIBUTIONS = {  # of modules: fsspec[http] brings aiohttp
    "PIL": "pillow",
    "skimage": "scikit-image",
    "vtkmodules": "vtk",
    "aiohttp": "fsspec",
    "jupyter_client": "jupyter-client",
    "kubernetes_validate": "kubernetes-validate",
    "prometheus_client": "prometheus-client",
}
IMPORTERS = {"library", "import_module"}  # functions that import what they are given by name
# With what belongs to a test alone.
OURS = {
    "volsplat",
    "support",
    "by_the_book",
    "reference",
    "tolerances",
    "fuzz",
    "faults",
    "first_pictures",
    "security",
    "large_library",
}
SOURCES = [path.relative_to(ROOT) for part in MAY_USE if "/" not in part for path in (ROOT / part).rglob("*.py")]


def distributions(requirements: list[str]) -> set[str]:
    names = {re.split(r"[^\w.-]", line)[0].lower() for line in requirements}
    return names - {"volsplat"}


DECLARED = {extra: distributions(lines) for extra, lines in PROJECT["optional-dependencies"].items()}
DECLARED[ALWAYS] = distributions(PROJECT["dependencies"])


def modules_run(tree: ast.AST) -> Iterator[str]:
    """What is imported when the code runs, not for type checkers alone."""
    for node in ast.iter_child_nodes(tree):
        match node:
            case ast.If(test=ast.Name(id="TYPE_CHECKING")):
                continue
            case ast.Import():
                yield from (alias.name for alias in node.names)
            case ast.ImportFrom(module=str(module)):
                yield module
            case ast.Call(
                func=ast.Name(id=name) | ast.Attribute(attr=name), args=[ast.Constant(value=str(module)), *_]
            ):
                if name in IMPORTERS:
                    yield module
        yield from modules_run(node)


@cache
def libraries_of(source: Path) -> set[str]:
    """The distributions that a file imports."""
    tree = ast.parse((ROOT / source).read_text(encoding="utf-8"))
    tops = {module.partition(".")[0] for module in modules_run(tree)} - sys.stdlib_module_names - OURS
    return {DISTRIBUTIONS.get(top, top).lower() for top in tops}


def test_a_file_imports_only_what_its_place_may_use() -> None:
    beyond = {}
    for source in SOURCES:
        place = max((place for place in MAY_USE if source.is_relative_to(place)), key=len)
        allowed = set[str]().union(*(DECLARED.get(name, {name}) for name in MAY_USE[place]))
        beyond[str(source)] = libraries_of(source) - allowed
    assert not {source: libraries for source, libraries in beyond.items() if libraries}


def test_every_library_that_is_declared_is_imported() -> None:
    used = set[str]().union(*map(libraries_of, SOURCES))
    for extra in {ALWAYS, *DECLARED} - BESIDE:
        assert DECLARED[extra] <= used, extra


def test_what_is_needed_always_has_no_torch() -> None:
    assert "torch" not in DECLARED[ALWAYS] and "torch" not in DECLARED["ui"] | DECLARED["notebook"]


def test_work_on_volsplat_brings_every_extra_and_what_tests_import() -> None:
    (own,) = [line for line in PROJECT["optional-dependencies"]["dev"] if line.startswith("volsplat")]
    extras = set(re.findall(r"\w+", own.removeprefix("volsplat")))
    assert extras == set(DECLARED) - {ALWAYS, "dev", "fuzz"}
    brought = DECLARED["dev"].union(*(DECLARED[extra] for extra in extras), DECLARED[ALWAYS])
    for path in (ROOT / "tests").rglob("*.py"):
        if "typings" not in path.parts and "fuzz" not in path.parts:
            assert libraries_of(path.relative_to(ROOT)) <= brought, path


def test_what_is_loaded_while_volsplat_is_compiled_is_what_pip_takes_for_it() -> None:
    """`make test` loads both at a time: without the list pip would compile volsplat first, to know its extras."""
    command = [sys.executable, str(ROOT / "packaging" / "libraries.py"), "dev"]
    listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    (own,) = [line for line in PROJECT["optional-dependencies"]["dev"] if line.startswith("volsplat")]
    extras = ["dev", *re.findall(r"\w+", own.removeprefix("volsplat"))]
    taken = PROJECT["dependencies"] + [line for extra in extras for line in PROJECT["optional-dependencies"][extra]]
    assert sorted(listed) == sorted({line for line in taken if not line.startswith("volsplat")})
