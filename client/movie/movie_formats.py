"""The kinds of movie that can be written, and whether one could be written here. Imports no image library."""

import shutil
from pathlib import Path

from volsplat.client.files.whole_file import is_stream
from volsplat.client.image.image_formats import check_place
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.file_names import check_utf8

# What ffmpeg is told for each kind. The qualities are such that neighbouring frames of fog show no blocks.
VIDEO_ENCODERS: dict[str, tuple[str, ...]] = {
    ".mp4": ("-c:v", "libx264", "-preset", "medium", "-crf", "18", "-movflags", "+faststart"),
    ".webm": ("-c:v", "libvpx-vp9", "-crf", "24", "-b:v", "0", "-deadline", "good", "-cpu-used", "3", "-row-mt", "1"),
}


MOST_FRAMES = 99_999  # their numbers have five digits


def frame_image_path(folder: Path, number: int) -> Path:
    """Where a frame's image lies in the folder of a movie, counted from 1."""
    return folder / f"frame-{number:05}.png"


def video_encoder(path: Path) -> tuple[str, ...] | None:
    """What ffmpeg is told of the file; None if `path` is a folder of images, or is to be one."""
    return None if path.is_dir() else VIDEO_ENCODERS.get(path.suffix.lower())


def movie_files(path: Path, frames: int) -> list[Path]:
    """What is written of a movie."""
    return [path] if video_encoder(path) else [frame_image_path(path, number + 1) for number in range(frames)]


def check_movie_writable(path: Path) -> None:
    """Raise BadInput, in one line, if no movie could be written to `path`. Nothing is left behind."""
    if video_encoder(path) is None:
        _check_folder(path)
        return
    check_place(path)
    if is_stream(path):
        raise BadInput(f"{path}: ffmpeg writes no movie into a pipe or a device; give the name of a file")
    if shutil.which("ffmpeg") is None:
        raise BadInput(
            f"{path}: {path.suffix} files are written by ffmpeg, which is not installed here; install it (Debian and "
            "Ubuntu: apt install ffmpeg), or give a folder for numbered PNG images"
        )


def check_clear(path: Path) -> None:
    """Raise BadInput for a film, whose images cannot be transparent."""
    if video_encoder(path) is not None:
        raise BadInput(f"{path}: a film cannot be transparent; give a folder for numbered PNG images")


def _check_folder(folder: Path) -> None:
    check_utf8(folder)
    if folder.is_dir():
        check_place(frame_image_path(folder, 1))
        if any(folder.glob("frame-*.png")):
            raise BadInput(f"{folder}: holds the images of a movie already; remove them, or give another folder")
        return
    if folder.exists() or folder.suffix:
        kinds = " or ".join(VIDEO_ENCODERS)
        raise BadInput(f"{folder}: cannot write this kind of movie; end the name in {kinds}, or give a folder (no dot)")
    check_place(folder)
