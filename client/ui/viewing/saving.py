"""What the page's panel for saving calls: images and scenes as bytes, scenes as links, movies on a thread.

Knows nothing of pages, so that it can be tested, and used, without one.
"""

from __future__ import annotations

import base64
import logging
import threading
import time
import zlib
from collections.abc import Callable, Sequence
from itertools import repeat
from pathlib import Path
from typing import Any, Literal
from urllib.parse import parse_qsl, urlencode, urlsplit, urlunsplit

import msgspec
from numpy.typing import ArrayLike

from volsplat.client.figure.characters import check_words
from volsplat.client.figure.figure import Figure
from volsplat.client.image.file_bytes import bytes_of
from volsplat.client.image.image_formats import SCENE_HOLDERS, need_pdf
from volsplat.client.image.image_properties import image_properties
from volsplat.client.movie.movie_formats import check_movie_writable
from volsplat.client.scene.scene_file import scene_from_bytes, scene_toml
from volsplat.client.session.finished_pixels import finished_pixels
from volsplat.client.session.renderer import Finisher
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.program.temporary_folder import temporary_folder
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import VolumeDescription
from volsplat.protocol.rules.refinement import finest_step
from volsplat.protocol.text.errors import BadInput, VolsplatError
from volsplat.protocol.text.printable import printable

log = logging.getLogger(__name__)

ImageFormat = Literal["png", "exr"]
FIGURE_KINDS = (".pdf", ".svg", ".png", ".tif")
SCENE_PARAMETER = "scene"  # of a link, in its query
VOLUME_PARAMETER = "volume"  # likewise, the name of what the scene is of
SCENE_FILE = ".toml"
SCENE_FILES = (SCENE_FILE, *SCENE_HOLDERS)  # what a scene can be taken from
LARGEST_UPLOAD = 1 << 25  # bytes, of an image

_LARGEST_SCENE = 1 << 20  # bytes of JSON that a link may unfold to


def image_bytes(image: ArrayLike, scene: Scene, kind: ImageFormat, description: VolumeDescription) -> bytes:
    """An (H, W, 4) float32 image with associated alpha as a file that holds its scene and tells of the volume.

    PNG has 8 bits and the scene's background under the image, EXR floats and alpha without it. Raises BadInput.
    """
    from volsplat.client.image.image_file import write_image

    properties = image_properties(description, scene)
    return bytes_of(f".{kind}", lambda path: write_image(path, image, scene, properties))


def figure_bytes(
    renderer: Finisher, scene: Scene, figure: Figure, kind: str, cancelled: Callable[[], bool]
) -> bytes | None:
    """The finished picture of a scene as a figure, in a file of one of FIGURE_KINDS; None once it is cancelled.

    Raises BadInput for what makes no figure, and as `Finisher.finish` does.
    """
    from volsplat.client.figure.figure_file import write_picture
    from volsplat.client.figure.layout import sized

    if kind == ".pdf":
        need_pdf()
    check_words(figure, Path(f"figure{kind}"))
    volume = renderer.volume
    scene = sized(figure, scene, volume)
    picture = finished_pixels(renderer, scene, finest_step(scene), cancelled)
    if picture is None:
        return None
    return bytes_of(kind, lambda path: write_picture(path, picture, scene, volume, figure))


def why_unlabelled(figure: Figure, scene: Scene, volume: SurveyedVolume) -> str:
    """One line that names the labels that the figure of a scene lacks; empty if it has all."""
    from volsplat.client.figure import pointing_labels
    from volsplat.client.figure.layout import sized

    return pointing_labels.why_unlabelled(figure.labels, sized(figure, scene, volume), volume)


def scene_bytes(scene: Scene) -> bytes:
    """The whole scene as commented TOML."""
    return scene_toml(scene).encode()


def scene_in_file(data: bytes, base: Scene, name: str) -> Scene:
    """That of a scene file, which may leave out what `base` has, or of an image. Raises BadInput, naming the file."""
    if Path(name).suffix.lower() in SCENE_HOLDERS:
        return _scene_in_image(data, name)
    return scene_from_bytes(data, base, printable(name))


def _scene_in_image(data: bytes, name: str) -> Scene:
    from volsplat.client.image.image_file import read_scene

    with temporary_folder() as folder:
        path = folder / f"image{Path(name).suffix.lower()}"
        path.write_bytes(data)
        try:
            return read_scene(path)
        except BadInput as error:
            raise BadInput(str(error).replace(str(path), printable(name))) from error


def scene_link(base_url: str, scene: Scene, default_scene: Scene, volume: str = "") -> str:
    """`base_url` with what differs from the default scene in its query, as text that a URL may hold.

    With the name of the `volume` as well it is known where it belongs.
    """
    changed = _changed(msgspec.to_builtins(default_scene), msgspec.to_builtins(scene))
    packed = zlib.compress(msgspec.json.encode(changed), 9)
    text = base64.urlsafe_b64encode(packed).decode().rstrip("=")
    parts = urlsplit(base_url)
    of_link = (SCENE_PARAMETER, VOLUME_PARAMETER)
    kept = [(name, value) for name, value in parse_qsl(parts.query) if name not in of_link]
    named = [(VOLUME_PARAMETER, volume)] if volume else []
    return urlunsplit(parts._replace(query=urlencode([*kept, (SCENE_PARAMETER, text), *named])))


def check_link_is_of(volume: str | None, shown: VolumeDescription) -> None:
    """Raises BadInput for a link to a scene of another volume than is shown; one may name none."""
    if volume not in (None, shown.name):
        raise BadInput(f"this link is to a scene of {printable(volume)}, and {shown.name} is shown; open that first")


def scene_from_link(text: str, base: Scene) -> Scene:
    """The scene of a link, or of the text after its `scene=`; what it leaves out is taken from `base`.

    Raises BadInput for anything that scene_link did not make.
    """
    try:
        text = dict(parse_qsl(urlsplit(text).query)).get(SCENE_PARAMETER, text)
        packed = base64.b64decode(text.encode("ascii") + b"=" * (-len(text) % 4), altchars=b"-_", validate=True)
        unpacking = zlib.decompressobj()
        content = unpacking.decompress(packed, _LARGEST_SCENE)
        if not unpacking.eof:
            raise BadInput("this link holds no whole scene; copy all of it")
        return msgspec.convert(_merged(msgspec.to_builtins(base), msgspec.json.decode(content)), Scene)
    except msgspec.ValidationError as error:
        raise BadInput(f"the scene in this link cannot be used: {printable(str(error))}") from error
    except (ValueError, zlib.error, msgspec.DecodeError, RecursionError) as error:
        raise BadInput("this link holds no scene; copy all of it") from error


def _changed(base: dict[str, Any], scene: dict[str, Any]) -> dict[str, Any]:
    """The keys whose values differ, and of the parts of a scene only such keys."""
    return {
        key: _changed(base[key], value) if isinstance(value, dict) else value
        for key, value in scene.items()
        if value != base[key]
    }


def _merged(base: Any, changed: Any) -> Any:
    """The inverse of _changed; what does not fit is left for the scene's own checks."""
    if not (isinstance(base, dict) and isinstance(changed, dict)):
        return changed
    return {**base, **{key: _merged(base.get(key), value) for key, value in changed.items()}}


class MovieJob:
    """A movie being made on a thread of its own, by the step that its first scene refines to.

    All that is told of it may be read from any thread, at any time.

    A frame that is pushed aside by whatever else draws with `renderer` is drawn again; one that pushes others aside
    leaves them with nothing, so that it must take its turn.
    """

    def __init__(
        self,
        renderer: Finisher,
        scenes: Sequence[Scene],
        path: Path,
        rate: int = 30,
        figure: Figure | None = None,
    ) -> None:
        """Start making it. Raises BadInput if it could not be written to `path`."""
        try:
            check_movie_writable(path)
        except OSError as error:
            raise BadInput(f"{path}: cannot be written: {error.strerror or error}") from error
        self.path = path
        self.error: str | None = None  # one line, if it failed; known before it is done
        self.line = "starting"  # how it goes, in words
        self.whole = False  # whether the movie lies at its path
        self._frames = len(scenes)
        self._drawn = 0
        self._began = time.monotonic()
        self._cancelled = threading.Event()
        self._done = threading.Event()
        self._thread = threading.Thread(
            target=self._run, args=(renderer, scenes, rate, figure), name="movie", daemon=True
        )
        self._thread.start()

    @property
    def progress(self) -> float:
        """0 to 1; 1 only when the movie is whole."""
        return 1.0 if self.whole else self._drawn / (self._frames + 1)

    @property
    def done(self) -> bool:
        """Nothing more will happen: it is whole, cancelled or failed."""
        return self._done.is_set()

    def cancel(self) -> None:
        """Have it end within one frame, with nothing left of it. Without effect once it is whole."""
        self._cancelled.set()

    def join(self) -> None:
        """Wait until it is done."""
        self._thread.join()

    def _run(self, renderer: Finisher, scenes: Sequence[Scene], rate: int, figure: Figure | None) -> None:
        from volsplat.client.figure.frame_figure import FrameFigure
        from volsplat.client.movie.movie import MovieCancelled, write_movie

        try:
            drawn, cancelled = self._on_progress, self._cancelled.is_set
            about = FrameFigure(figure, scenes, renderer.volume) if figure is not None else None
            step = finest_step(scenes[0])
            write_movie(repeat(renderer), scenes, self.path, rate, drawn, cancelled, step, about)
            self.whole = True
            self.line = f"{self._frames} images"
        except MovieCancelled:
            self.line = "cancelled"
        except VolsplatError as error:
            self.error = self.line = str(error)
        except Exception as error:  # an error in our own code: whoever waits must hear of it
            log.exception("the movie cannot be made")
            self.error = self.line = f"the movie cannot be made: {type(error).__name__}: {error}"
        finally:
            self._done.set()

    def _on_progress(self, drawn: int) -> None:
        self._drawn = drawn
        left = (self._frames - drawn) * (time.monotonic() - self._began) / drawn
        self.line = f"image {drawn} of {self._frames}" + (f", {left:.0f} s left" if left >= 1 else "")
