"""The kinds of image file that can be written, and whether one could be written here. Imports no image library."""

import os
from pathlib import Path

from volsplat.client.files.whole_file import is_stream
from volsplat.program.extras import need
from volsplat.program.temporary_name import behind_links, temporary_name
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.file_names import check_utf8

EXACT = ".exr"  # floats; all others have 8 bits a channel
IMAGE_FORMATS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", EXACT)
SCENE_HOLDERS = (*IMAGE_FORMATS, ".svg")  # what a scene can be read from
VECTOR_FORMATS = (".svg", ".pdf")  # with the picture inside
OPAQUE = (".jpg", ".jpeg")


def check_writable(path: Path) -> None:
    """Raise BadInput, in one line, if no image could be written to `path`. Nothing is left behind."""
    if path.suffix.lower() not in IMAGE_FORMATS:
        endings = ", ".join((*IMAGE_FORMATS, *VECTOR_FORMATS))
        raise BadInput(f"{path}: cannot write this kind of image; end the name in one of {endings}")
    check_utf8(path)
    check_place(path)


def check_picture_writable(path: Path, transparent: bool) -> None:
    """As check_writable, with the formats that a figure may have besides, and of a kind that can be transparent."""
    kind = path.suffix.lower()
    if kind not in VECTOR_FORMATS:
        check_writable(path)
        if transparent and kind in OPAQUE:
            raise BadInput(f"{path}: JPEG cannot be transparent; end the name in .png, .tif, .svg or .pdf")
        return
    check_place(path)
    if kind == ".pdf":
        need_pdf()


def need_pdf() -> None:
    """Raises BadInput, with the cure, if PDF cannot be written here."""
    need("reportlab", "a PDF file", "pdf")


def check_place(path: Path) -> None:
    """Raise BadInput, in one line, if no file of any kind could be written to `path`. Nothing is left behind."""
    if path.is_dir():
        raise BadInput(f"{path}: is a folder; give the name of a file")
    if path.exists() and not os.access(path, os.W_OK):
        raise BadInput(f"{path}: the file there is write-protected; give another name")
    if is_stream(path):
        return
    folder = behind_links(path).parent
    if not folder.is_dir():
        raise BadInput(f"{path}: there is no folder {folder}; make it first")
    trial = temporary_name(folder / path.name)
    try:
        trial.touch()
        trial.unlink()
    except OSError as error:
        raise BadInput(f"{path}: cannot write into the folder {folder}: {error.strerror}") from error
