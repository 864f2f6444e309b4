"""The names of the six images of successive refinement in their folder."""

from pathlib import Path

from volsplat.protocol.scene import Step


def step_image_path(folder: Path, step: Step) -> Path:
    return folder / f"step-{step}.png"
