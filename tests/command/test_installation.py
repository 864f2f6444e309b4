"""What is installed where: torch as its CPU build, and not at all where servers only work for others."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from importlib.metadata import requires
from pathlib import Path

import pytest
import torch

from support.checkout import ROOT
from support.files.loopback_files import served
from support.patience import PATIENCE
from support.programs.programs import Person
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.session.session import Session
from volsplat.client.session.single import SingleProcess
from volsplat.program.exit_status import EXIT_BAD_INPUT

CPU_TORCH = ROOT / "packaging" / "cpu_torch.py"
WITHOUT_TORCH = 'import sys\nsys.modules["torch"] = None\n'  # to Python: there is no such module


@pytest.fixture
def without_torch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Programs that are started now find no torch."""
    (tmp_path / "absent").mkdir()
    (tmp_path / "absent" / "sitecustomize.py").write_text(WITHOUT_TORCH)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "absent"))


def test_torch_comes_with_the_client_only() -> None:
    always = [line for line in requires("volsplat") or [] if "extra ==" not in line]
    assert any(line.startswith("numpy") for line in always)
    assert not any(line.startswith("torch") for line in always)


@pytest.mark.usefixtures("without_torch")
def test_servers_draw_without_torch(tmp_path: Path) -> None:
    write_volume(tmp_path / "head.nrrd", *make_phantom("head", size=(24, 32, 28)))
    with SingleProcess(tmp_path / "head.nrrd") as single:
        scene = single.volume.default_scene()
        expected = single.render(scene)
    with Session(tmp_path / "head.nrrd", workers=2) as session:
        assert torch.equal(session.render(scene), expected)


@pytest.mark.usefixtures("without_torch")
@pytest.mark.parametrize("command", ["render head.nrrd -o head.png", "phantom head -o head.nrrd", "demo"])
def test_a_command_that_needs_torch_names_the_extra(tmp_path: Path, command: str) -> None:
    (tmp_path / "head.nrrd").write_bytes(b"")
    started = Person(tmp_path).starts(*command.split())
    _, said = started.communicate(timeout=PATIENCE)
    assert started.returncode == EXIT_BAD_INPUT
    assert "torch" in said and "pip install 'volsplat[client]'" in said
    assert len(said.splitlines()) == 1


def _offer(folder: Path, name: str, version: str, needs: str = "", size: int = 0) -> None:
    """Put a package into an index: its page, and a wheel with nothing but what pip asks of it, and `size` bytes."""
    place, plain = folder / name, name.replace("-", "_")
    place.mkdir(parents=True)
    wheel_name, info = f"{plain}-{version}-py3-none-any.whl", f"{plain}-{version}.dist-info"
    metadata = f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n"
    with zipfile.ZipFile(place / wheel_name, "w") as wheel:
        wheel.writestr(f"{info}/METADATA", metadata + (f"Requires-Dist: {needs}\n" if needs else ""))
        wheel.writestr(f"{info}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        wheel.writestr(f"{info}/RECORD", "")
        wheel.writestr("filler", bytes(size))
    (place / "index.html").write_text(
        f'<!DOCTYPE html><html><body><a href="{wheel_name}">{wheel_name}</a></body></html>'
    )


def _plan(cpu_index: str, other_index: str) -> subprocess.CompletedProcess[str]:
    """What would be loaded by someone who has these two indexes and no wheels at hand."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PIP_")}
    return subprocess.run(
        [sys.executable, str(CPU_TORCH), "--index", cpu_index, "--dry-run"],
        env={**kept, "PIP_CONFIG_FILE": os.devnull, "PIP_INDEX_URL": other_index},
        capture_output=True,
        encoding="utf-8",
        timeout=PATIENCE,
    )


@pytest.fixture
def with_cuda(tmp_path: Path) -> Iterator[str]:
    """An index like PyPI's, whose torch brings CUDA."""
    _offer(tmp_path / "cuda", "torch", "2.13.0", needs="nvidia-cublas")
    _offer(tmp_path / "cuda", "nvidia-cublas", "13.1.1", size=2_000_000)
    with served(tmp_path / "cuda") as index:
        yield index.url


def test_torch_is_taken_from_the_index_of_cpu_builds(tmp_path: Path, with_cuda: str) -> None:
    _offer(tmp_path / "cpu", "torch", "2.13.0+cpu")
    with served(tmp_path / "cpu") as index:
        answer = _plan(index.url, with_cuda)
    assert answer.returncode == 0
    assert answer.stdout == "torch 2.13.0+cpu\n"
    assert answer.stderr == ""


def test_a_build_with_cuda_is_announced_with_its_size(tmp_path: Path, with_cuda: str) -> None:
    (tmp_path / "empty").mkdir()
    with served(tmp_path / "empty") as index:
        answer = _plan(index.url, with_cuda)
    assert answer.returncode == 0
    assert "nvidia-cublas 13.1.1" in answer.stdout
    assert f"({index.url}) does not answer" in answer.stderr
    assert "1 package more, 2 MB to load" in answer.stderr
