"""Runs the real command as a person would, and looks for servers that it left behind."""

import os
import secrets
import subprocess
import sys
from pathlib import Path

import psutil

VOLSPLAT = Path(sys.executable).parent / "volsplat"
TIME_LIMIT = 120.0  # seconds after which a hanging program fails its test
SERVER_MODULES = ("volsplat.mapshade_server", "volsplat.splat_server")


class Person:
    """Someone at a keyboard in a folder, with a session token of their own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.token = secrets.token_urlsafe(32)

    @property
    def environment(self) -> dict[str, str]:
        return {**os.environ, "VOLSPLAT_TOKEN": self.token}

    def runs(self, *arguments: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [str(VOLSPLAT), *arguments],
            cwd=self.folder,
            env=self.environment,
            capture_output=True,
            encoding="utf-8",
            timeout=TIME_LIMIT,
        )

    def starts(self, *arguments: str) -> "subprocess.Popen[str]":
        return subprocess.Popen(
            [str(VOLSPLAT), *arguments],
            cwd=self.folder,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
        )

    def servers(self) -> list[psutil.Process]:
        """The servers that run with this person's token."""
        found = []
        for process in psutil.process_iter(["cmdline"]):
            if any(module in (process.info["cmdline"] or []) for module in SERVER_MODULES):
                try:
                    if process.environ().get("VOLSPLAT_TOKEN") == self.token and process.is_running():
                        found.append(process)
                except psutil.NoSuchProcess:
                    continue
        return found
