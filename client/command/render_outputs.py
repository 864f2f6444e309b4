"""The files that the render command leaves, and whether they could be written."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from volsplat.client.image.image_formats import check_picture_writable, check_writable
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.file_names import check_utf8
from volsplat.protocol.text.open_streams import stream_number


def step_image_path(folder: Path, step: Step) -> Path:
    """Where a step's image lies in the folder of all six."""
    return folder / f"step-{step}.png"


@dataclass(frozen=True)
class Outputs:
    """What a person wants written. None: not asked for."""

    image: Path | None
    steps_dir: Path | None
    report: Path | None
    transparent: bool = False

    @property
    def pictures(self) -> list[Path | None]:
        steps = [] if self.steps_dir is None else [step_image_path(self.steps_dir, step) for step in Step]
        return [self.image, *steps]

    def check(self) -> None:
        """Raise BadInput before any work if a file could not be written."""
        if self.image is None and self.steps_dir is None:
            raise BadInput("nothing to write: give -o IMAGE, --steps-dir FOLDER, or both")
        if self.image is not None:
            check_picture_writable(self.image, self.transparent)
        if self.steps_dir is not None:
            _check_folder(self.steps_dir)
        if self.report is not None:
            check_file_writable("--report", self.report)

    def make_folder(self) -> None:
        """Make the folder of the steps. Raises BadInput."""
        if self.steps_dir is not None:
            try:
                self.steps_dir.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise BadInput(f"{self.steps_dir}: cannot make this folder: {error.strerror}") from error


def check_file_writable(option: str, path: Path) -> None:
    """Raises BadInput for a file that an option names and that could not be written."""
    if str(path) == "-":
        raise BadInput(f"{option} -: is no name of a file here; {option} /dev/stdout writes to the standard output")
    written = path.parent if path.is_file() or not path.exists() else path  # a device or a pipe
    if path.is_dir() or (stream_number(path) is None and not os.access(written, os.W_OK)):
        raise BadInput(f"{path}: cannot write this file; name another with {option}")


def _check_folder(folder: Path) -> None:
    check_utf8(folder)
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not there.is_dir() or not os.access(there, os.W_OK):
        raise BadInput(f"{folder}: {there} is no folder that can be written; name another with --steps-dir")
    if there == folder:
        check_writable(step_image_path(folder, Step.A))
