"""What no linter of ours sees in names: one that is given twice, and the words that the design does not use."""

import ast
import re
import subprocess
from collections import Counter

import pytest

from support.checkout import ROOT

_TRACKED = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, encoding="utf-8", check=True).stdout
PYTHON = [ROOT / name for name in _TRACKED.split() if name.endswith((".py", ".pyi")) and not (ROOT / name).is_symlink()]
HOOKS = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")


def given(module: ast.Module) -> Counter[str]:
    """How often each name is given at the top of a module."""
    names: list[str] = []
    for node in module.body:
        match node:
            case ast.Assign(targets=targets):
                parts = [part for target in targets for part in ast.walk(target) if isinstance(part, ast.Name)]
                names += [part.id for part in parts if isinstance(part.ctx, ast.Store)]
            case ast.FunctionDef(decorator_list=[ast.Name(id="overload")]):
                pass  # one more signature of a function that follows
            case ast.AnnAssign(target=ast.Name(id=name)) | ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                names.append(name)
    return Counter(names)


@pytest.mark.parametrize(
    ("text", "times"),
    [
        ("A = 1\nA = 2", 2),
        ("A: int = 1\ndef A(): ...", 2),
        ("A, B = 1, 2", 1),
        ("@overload\ndef A(): ...\ndef A(): ...", 1),
    ],
)
def test_a_name_is_counted_however_it_is_given(text: str, times: int) -> None:
    assert given(ast.parse(text))["A"] == times


def test_no_module_gives_a_name_twice() -> None:
    """Of two constants of one name the first is lost without a word, and with it what its reason says."""
    twice = {
        f"{path.relative_to(ROOT)}: {name}"
        for path in PYTHON
        for name, times in given(ast.parse(path.read_text(encoding="utf-8"))).items()
        if times > 1
    }
    assert twice == set()


def test_nothing_has_a_word_that_a_hook_forbids() -> None:
    forbidden = [re.compile(entry) for entry in re.findall(r"entry: '(.+)'\n +language: pygrep", HOOKS)]
    assert forbidden
    for path in PYTHON:
        text = path.read_text(encoding="utf-8")
        assert not any(pattern.search(text) for pattern in forbidden), path


def test_the_makefile_names_tests_that_are_there() -> None:
    """Those of `make clang` are run by nobody else."""
    tell = ["make", "-s", "--eval", "tell: ; @echo $(KERNEL_TESTS) $(PROPERTIES)", "tell"]
    named = subprocess.run(tell, cwd=ROOT, capture_output=True, encoding="utf-8", check=True).stdout.split()
    assert len(named) > 10 and not [name for name in named if not (ROOT / name.partition("::")[0]).is_file()]
