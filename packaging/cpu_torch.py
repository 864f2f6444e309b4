"""Installs torch into the environment of the Python that runs this: its CPU build, wherever one can be had.

PyPI's torch for Linux brings CUDA, gigabytes that volsplat never uses. So PyTorch's own index of CPU builds is asked
first, briefly; where it does not answer, pip's other sources decide, and a build with CUDA is announced with its size
before anything is loaded. Standard library only: nothing is installed yet when this runs.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import urllib.request
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

CPU_INDEX = "https://download.pytorch.org/whl/cpu"
CONSTRAINTS = Path(__file__).parent.parent / "constraints.txt"
PIP = (sys.executable, "-m", "pip", "--disable-pip-version-check")
BRIEFLY = ("--timeout", "10", "--retries", "0")
CUDA_PREFIXES = ("nvidia-", "cuda-", "triton")
SIZE_SECONDS = 10  # to wait for a server that is asked how large a file is


@dataclass(frozen=True)
class Package:
    """What pip would load."""

    name: str
    version: str
    url: str

    @property
    def is_cuda(self) -> bool:
        return self.name.startswith(CUDA_PREFIXES)


def planned(sources: Sequence[str]) -> list[Package] | None:
    """What pip would load for torch from these sources (options of pip's), or None where it finds no torch there."""
    command = [*PIP, "install", "--dry-run", "--ignore-installed", "--quiet", "--report", "-", *_wanted(sources)]
    answer = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, check=False)
    if answer.returncode != 0:
        return None
    return [
        Package(item["metadata"]["name"].lower(), item["metadata"]["version"], item["download_info"]["url"])
        for item in json.loads(answer.stdout)["install"]
    ]


def cuda_warning(index: str, packages: Sequence[Package]) -> str:
    """What a person should know before so much is loaded."""
    cuda = sum(package.is_cuda for package in packages)
    size = total_bytes(packages)
    much = f"{_size_text(size)} to load, and about twice as much on disk" if size else "gigabytes"
    return (
        f"PyTorch's index of CPU builds ({index}) does not answer. pip's other sources have torch with CUDA only: "
        f"{cuda} package{'s' if cuda > 1 else ''} more, {much}; volsplat never uses them.\n"
        "To do without: Ctrl-C, put a CPU wheel of torch into a folder, set PIP_FIND_LINKS to it, and start again."
    )


def total_bytes(packages: Sequence[Package]) -> int:
    """The files' sizes as their servers state them; 0 where one of them does not."""
    with ThreadPoolExecutor() as pool:
        sizes = list(pool.map(_file_bytes, (package.url for package in packages)))
    return sum(sizes) if all(sizes) else 0


def _size_text(size: int) -> str:
    return f"{size / 1e9:.1f} GB" if size >= 1e9 else f"{size / 1e6:.0f} MB"


def _file_bytes(url: str) -> int:
    try:
        asked = urllib.request.Request(url, method="HEAD")
        with urllib.request.urlopen(asked, timeout=SIZE_SECONDS) as answer:
            return int(answer.headers.get("Content-Length", 0))
    except (OSError, ValueError):
        return 0


def _wanted(sources: Sequence[str]) -> list[str]:
    return ["--constraint", str(CONSTRAINTS), *sources, "torch"]


def main() -> int:
    parser = argparse.ArgumentParser(description="Install torch, as its CPU build if one can be had.")
    parser.add_argument("--index", default=CPU_INDEX, help=f"index of CPU builds ({CPU_INDEX})")
    parser.add_argument("--dry-run", action="store_true", help="only say what would be loaded")
    options = parser.parse_args()
    if find_spec("torch") is not None and not options.dry_run:
        return 0
    sources = ["--index-url", options.index, *BRIEFLY]
    packages = planned(sources)
    if packages is None:
        sources = []
        packages = planned(sources)
    if packages is not None and any(package.is_cuda for package in packages):
        print(cuda_warning(options.index, packages), file=sys.stderr, flush=True)
    if options.dry_run:
        for package in packages or []:
            print(f"{package.name} {package.version}")
        return 0 if packages else 1
    return subprocess.run([*PIP, "install", *_wanted(sources)], check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
