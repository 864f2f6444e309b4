"""Movies: numbered images in a folder by OpenImageIO, or one file by ffmpeg; whole or not at all.

Frames go to ffmpeg through a pipe, as they are drawn. A file lies beside its target, and images in a hidden folder,
until all are there; then they take their names.
"""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from volsplat.client.caller.arguments import checked_scene
from volsplat.client.caller.interrupts import interrupts_held
from volsplat.client.figure.frame_figure import FrameFigure
from volsplat.client.image.image_file import coded, write_image
from volsplat.client.image.image_properties import image_properties
from volsplat.client.movie.movie_formats import check_movie_writable, frame_image_path, video_encoder
from volsplat.client.session.finished_pixels import finished_pixels
from volsplat.client.session.renderer import Finisher
from volsplat.program.temporary_name import behind_links, take_mode, temporary_name
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import VolumeDescription
from volsplat.protocol.text.errors import BadInput, VolsplatError

_ENDING_INTERVAL = 0.1  # seconds between two questions whether to cancel while ffmpeg ends its file
_LONGEST_COMPLAINT = 300  # characters of what ffmpeg says

Pixels = NDArray[np.float32]
Put = Callable[[Pixels, Scene, VolumeDescription], None]  # takes the next frame: (H, W, 4), associated


class MovieCancelled(Exception):
    """Whoever asked for the movie wants it no more; nothing of it is left."""


def write_movie(
    renderers: Iterable[Finisher],
    scenes: Sequence[Scene],
    path: Path,
    rate: int,
    on_progress: Callable[[int], None],
    cancelled: Callable[[], bool],
    step: Step = Step.F,
    figure: FrameFigure | None = None,
) -> None:
    """Draw each scene at one step into an .mp4 or .webm of `rate` frames a second, or into a folder of PNG images.

    `renderers` gives each scene's in turn, and is asked for the next one once the frame before is written. With a
    figure of these scenes each image is one, all as large as the largest. `on_progress` gets the number of frames that
    are done. Raises BadInput if the movie cannot be written or a scene does not fit the volume, VolsplatError if ffmpeg
    or the servers fail, and MovieCancelled at most one frame after `cancelled` says so; nothing is left behind then.
    """
    scenes = [checked_scene(scene) for scene in scenes]
    width, height = _size_of_all(scenes)
    check_movie_writable(path)
    if figure is not None:
        width, height = figure.extent
    encoder = video_encoder(path)
    if encoder is None:
        opened = _images(path, figure)
    else:
        opened = _video(path, encoder, rate, width, height, cancelled)
    try:
        with opened as put:
            for done, (scene, renderer) in enumerate(zip(scenes, renderers, strict=False)):
                image = finished_pixels(renderer, scene, step, cancelled)
                if image is None:
                    raise MovieCancelled
                frame = image if figure is None else figure.pixels(image, scene)
                put(frame, scene, renderer.volume.description)
                on_progress(done + 1)
            if cancelled():
                raise MovieCancelled
    except OSError as error:
        raise BadInput(f"{path}: cannot write the movie: {error.strerror or error}") from error


def _size_of_all(scenes: Sequence[Scene]) -> tuple[int, int]:
    sizes = sorted({(scene.image.width, scene.image.height) for scene in scenes})
    if len(sizes) != 1:
        named = " and ".join(f"{width}x{height}" for width, height in sizes[:2])
        raise BadInput(f"the scenes of a movie need one image size, but there are {named}; give all of them the same")
    return sizes[0]


@contextmanager
def _images(folder: Path, figure: FrameFigure | None) -> Iterator[Put]:
    """Numbers the images from 1 in a hidden folder within `folder`; they move up when all are there."""
    made = not folder.exists()
    hidden = temporary_name(folder / "frames")
    images: list[Path] = []
    whole = False
    dpi, transparent = (figure.figure.resolution, figure.figure.transparent) if figure is not None else (None, False)

    def put(image: Pixels, scene: Scene, description: VolumeDescription) -> None:
        images.append(frame_image_path(hidden, len(images) + 1))
        try:
            properties = image_properties(description, scene)
            write_image(images[-1], image, scene, properties, dpi=dpi, transparent=transparent)
        except BadInput as error:
            raise BadInput(str(error).replace(str(hidden), str(folder))) from error

    try:
        hidden.mkdir(parents=True)
        yield put
        with interrupts_held():
            for image in images:
                image.rename(folder / image.name)
            whole = True
    finally:
        with interrupts_held():
            shutil.rmtree(hidden, ignore_errors=True)
            if made and not whole and folder.exists():
                folder.rmdir()


@contextmanager
def _video(
    path: Path, encoder: Sequence[str], rate: int, width: int, height: int, cancelled: Callable[[], bool]
) -> Iterator[Put]:
    """Pipes the frames to ffmpeg, which writes beside `path`; the file is renamed to it once ffmpeg has ended well."""
    target = behind_links(path)
    temporary = temporary_name(target)
    command = _ffmpeg_command(encoder, rate, width + width % 2, height + height % 2, temporary)
    ffmpeg: subprocess.Popen[bytes] | None = None
    with tempfile.TemporaryFile() as complaints:  # never full, as a pipe that nobody reads would be
        try:
            with interrupts_held():
                temporary.touch()
                take_mode(temporary, target)
                # A session of its own: Ctrl-C ends it by way of this process, which knows what to say.
                ffmpeg = subprocess.Popen(
                    command,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.DEVNULL,
                    stderr=complaints,
                    bufsize=0,
                    start_new_session=True,
                )
            frames = ffmpeg.stdin
            assert frames is not None
            refused = False
            try:
                yield lambda image, scene, description: _send(frames, _levels(image, scene))
                frames.close()
            except BrokenPipeError:
                refused = True
            _await_end(ffmpeg, cancelled)
            if refused or ffmpeg.returncode != 0:
                said = _read_complaints(complaints).replace(str(temporary.absolute()), path.name)
                failure = BadInput if os.strerror(errno.ENOSPC) in said else VolsplatError
                raise failure(f"{path}: ffmpeg could not write the movie: {said}")
            os.replace(temporary, target)
        finally:
            with interrupts_held():
                if ffmpeg is not None:
                    ffmpeg.kill()
                    ffmpeg.communicate()
                temporary.unlink(missing_ok=True)


def _ffmpeg_command(encoder: Sequence[str], rate: int, width: int, height: int, output: Path) -> list[str]:
    """Raw RGB on stdin. The colours of the file are those of HD television, and it says so, else players guess.

    Without -xerror a disk that is full at the end is a success to ffmpeg. What stands before a colon in a relative path
    is a protocol to it.
    """
    source = ["-f", "rawvideo", "-pixel_format", "rgb24", "-video_size", f"{width}x{height}", "-framerate", str(rate)]
    colours = ["-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "iec61966-2-1", "-color_range", "tv"]
    return [
        *("ffmpeg", "-hide_banner", "-loglevel", "error", "-xerror", "-nostdin", "-y", *source, "-i", "pipe:0"),
        *("-vf", "scale=out_color_matrix=bt709:out_range=tv:flags=accurate_rnd+full_chroma_int+bicubic"),
        *("-pix_fmt", "yuv420p", *colours, *encoder, str(output.absolute())),
    ]


def _levels(image: Pixels, scene: Scene) -> memoryview:
    """(H, W, 3) uint8 over the background, as a PNG has it; a row and a column more if the sizes are odd."""
    height, width, _ = image.shape
    padded = np.pad(image, ((0, height % 2), (0, width % 2), (0, 0)))
    return coded(padded, scene.image.background).data.cast("B")


def _send(frames: IO[bytes], left: memoryview) -> None:
    while left:
        left = left[frames.write(left) :]


def _await_end(ffmpeg: subprocess.Popen[bytes], cancelled: Callable[[], bool]) -> None:
    while True:
        try:
            ffmpeg.wait(_ENDING_INTERVAL)
            return
        except subprocess.TimeoutExpired:
            if cancelled():
                raise MovieCancelled from None


def _read_complaints(complaints: IO[bytes]) -> str:
    complaints.seek(0)
    text = "; ".join(complaints.read().decode(errors="replace").split("\n")).strip("; ")
    return text[-_LONGEST_COMPLAINT:] or "it ended without a word"
