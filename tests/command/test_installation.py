"""What is installed where: torch as its CPU build, and not at all on a machine that draws without tensors."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
import torch

from support.checkout import ROOT
from support.files.images import read_image
from support.files.loopback_files import served
from support.pages.viewed import viewed_from_shell
from support.patience import PATIENCE
from support.programs.programs import Person
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.session.single import SingleProcess
from volsplat.program.exit_status import EXIT_BAD_INPUT

CPU_TORCH = ROOT / "packaging" / "cpu_torch.py"
CURE = "pip install --extra-index-url https://download.pytorch.org/whl/cpu 'volsplat[torch]'"
PAGE_LIBRARIES = ("nicegui", "fastapi", "starlette", "uvicorn")


def _hide(libraries: Sequence[str], folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Programs that are started now find none of these."""
    (folder / "absent").mkdir()
    hides = "".join(f"sys.modules[{library!r}] = None\n" for library in libraries)  # to Python: no such module
    (folder / "absent" / "sitecustomize.py").write_text(f"import sys\n{hides}")
    monkeypatch.setenv("PYTHONPATH", str(folder / "absent"))


@pytest.fixture
def without_torch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _hide(["torch"], tmp_path, monkeypatch)


def ended(folder: Path, command: str) -> tuple[int, list[str]]:
    """The status of a command as a shell starts it, and its mistakes in its words."""
    started = Person(folder).starts(*command.split())
    _, said = started.communicate(timeout=PATIENCE)
    return started.returncode, [line for line in said.splitlines() if line.startswith("volsplat: ")]


@pytest.fixture
def head(tmp_path: Path) -> Path:
    write_volume(tmp_path / "head.nrrd", *make_phantom("head", size=(24, 32, 28)))
    return tmp_path / "head.nrrd"


@pytest.mark.usefixtures("without_torch")
def test_images_are_drawn_and_written_without_torch(head: Path) -> None:
    with SingleProcess(head) as single:
        expected = single.render(single.volume.default_scene())
    for name, options in {"servers": "--workers 2", "single": "--single"}.items():
        assert ended(head.parent, f"render head.nrrd -o {name}.exr {options}") == (0, [])
        assert torch.equal(read_image(head.parent / f"{name}.exr"), expected)
    for command in (
        "render head.nrrd --steps-dir steps --scene single.exr",
        "movie head.nrrd -o film --frames 2 --size 16x16",
        "info head.nrrd",
    ):
        assert ended(head.parent, command) == (0, [])


@pytest.mark.usefixtures("without_torch")
def test_the_page_draws_without_torch(head: Path) -> None:
    with viewed_from_shell(head.parent, head, "--workers", "1") as view, view.viewport("a") as viewport:
        viewport.says("size", width=64, height=64)
        assert viewport.last_picture()[-1].data.startswith(b"\x89PNG")


@pytest.mark.usefixtures("without_torch")
def test_a_tensor_without_torch_is_one_line_with_the_cure(head: Path) -> None:
    program = (
        "from volsplat.client.session.single import SingleProcess\n"
        "from volsplat.protocol.text.errors import BadInput\n"
        f"with SingleProcess({str(head)!r}) as single:\n"
        "    scene = single.volume.default_scene()\n"
        "    assert single.finish(scene).published.pixels.shape == (512, 512, 4)\n"
        "    try:\n"
        "        single.render(scene)\n"
        "    except BadInput as error:\n"
        "        print(error)\n"
    )
    answer = subprocess.run([sys.executable, "-c", program], capture_output=True, encoding="utf-8", check=True)
    assert answer.stdout == f"an image as a tensor needs torch, which is not installed: {CURE}\n"


@pytest.mark.usefixtures("without_torch")
@pytest.mark.parametrize("command", ["phantom head -o head.nrrd", "demo", "gallery out", "bench kernels"])
def test_a_command_that_needs_torch_names_the_extra(tmp_path: Path, command: str) -> None:
    said = f"volsplat: {command.split()[0]} needs torch, which is not installed: {CURE}"
    assert ended(tmp_path, command) == (EXIT_BAD_INPUT, [said])


@pytest.mark.parametrize("command", ["view head.nrrd", "view", "bench page"])
def test_the_page_names_its_extra(command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _hide(PAGE_LIBRARIES, tmp_path, monkeypatch)
    said = "volsplat: the page needs nicegui, which is not installed: pip install 'volsplat[ui]'"
    assert ended(tmp_path, command) == (EXIT_BAD_INPUT, [said])


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
