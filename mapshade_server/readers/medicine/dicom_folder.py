"""The DICOM images of a folder: its own, else those further down, else what the DICOMDIR of a disc lists."""

import warnings
from collections.abc import Iterator
from pathlib import Path

from volsplat.mapshade_server.readers.medicine.dicom_file import (
    PREAMBLE,
    DicomFile,
    dicom_file,
    recognises,
    recognises_old,
)
from volsplat.mapshade_server.readers.reading.extra import library
from volsplat.mapshade_server.readers.reading.file_marks import check_is_file, leads_nowhere, mark_of_folder
from volsplat.mapshade_server.readers.reading.opened_file import opened
from volsplat.protocol.text.errors import BadInput

DIRECTORY_NAMES = ("DICOMDIR", "dicomdir", "DICOMDIR.", "DICOMDIR.;1")  # as discs are mounted
DEEPEST = 4  # folders down: a disc's own, then its patients, studies and series
MOST_FILES = 50_000  # that are looked at


def images_of(folder: Path) -> list[DicomFile]:
    """All images that a folder is for. Raises BadInput if there are none, one is damaged or lost, or one is a FIFO."""
    for path in folder.iterdir():
        if path.name[0] != "." and path.exists():
            check_is_file(path)
    files = list(_images(folder)) or _listed(folder)
    if not files and (mark := mark_of_folder(folder)) is not None:  # further down may lie very many files
        raise BadInput(f"{folder}: is {mark.what}, which is not read; {mark.cure}")
    lost = list(_lost(folder))
    files = files or list(_further_down(folder, lost))
    if not files:
        for path in lost:
            check_is_file(path)
        raise BadInput(
            f"{folder}: a folder without DICOM images, and none within {DEEPEST} folders further down; give a volume "
            "file or the folder of a DICOM series"
        )
    return files


def series_of(path: Path, uid: str) -> list[DicomFile]:
    """The images of one series that lie beside `path`, itself included."""
    return [file for file in _images(path.parent) if file.series_uid == uid]


def _images(folder: Path) -> Iterator[DicomFile]:
    """The folder's own images. Raises BadInput if another one, likely, is a link that leads nowhere."""
    some = False
    for path in sorted(folder.iterdir()):
        if path.is_file() and (told := _image(path)) is not None:
            some = True
            yield told
    for path in _lost(folder) if some else ():
        check_is_file(path)


def _lost(folder: Path) -> Iterator[Path]:
    """Links that lead nowhere, but for hidden ones."""
    return (path for path in sorted(folder.iterdir()) if path.name[0] != "." and leads_nowhere(path))


def _image(path: Path) -> DicomFile | None:
    """What a file says, None if it is no image of DICOM."""
    with opened(path) as file:
        head = file.read(PREAMBLE + 4)
    if recognises(head):
        return dicom_file(path)
    return image_if_readable(path) if recognises_old(head) else None


def image_if_readable(path: Path) -> DicomFile | None:
    """What a file says that only may be DICOM, None if it is no image or damaged."""
    try:
        return dicom_file(path)
    except BadInput:
        return None


def _further_down(folder: Path, lost: list[Path]) -> Iterator[DicomFile]:
    """Images in the folders of a folder, and in theirs; links there that lead nowhere are added to `lost`."""
    left = MOST_FILES
    waiting = [(inner, 1) for inner in _folders(folder)]
    while waiting:
        inner, depth = waiting.pop(0)
        left -= sum(1 for _ in inner.iterdir())
        if left < 0:
            raise BadInput(
                f"{folder}: more than {MOST_FILES} files lie {DEEPEST} folders down, and none in it is DICOM; "
                "give the folder of one study or series"
            )
        yield from _images(inner)
        lost += _lost(inner)
        if depth < DEEPEST:
            waiting += [(one, depth + 1) for one in _folders(inner)]


def _folders(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.is_dir() and not path.is_symlink())


def _listed(folder: Path) -> list[DicomFile]:
    """The images that a disc's directory lists and that are there, none if there is no directory."""
    directory = next((folder / name for name in DIRECTORY_NAMES if (folder / name).is_file()), None)
    if directory is None:
        return []
    found = (_there(folder, parts) for parts in _references(directory))
    return [told for path in found if path is not None and (told := _image(path)) is not None]


def _references(directory: Path) -> list[list[str]]:
    """The parts of the paths of all images in a DICOMDIR."""
    pydicom = library("pydicom", "DICOM")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of values that are against the standard
            records = pydicom.dcmread(directory, force=True).get("DirectoryRecordSequence", [])
            named = [
                record.get("ReferencedFileID") for record in records if record.get("DirectoryRecordType") == "IMAGE"
            ]
    except OSError:
        raise
    except Exception as error:  # of a damaged file pydicom makes anything
        raise BadInput(f"{directory}: cannot be parsed ({error}); give a folder of the disc instead") from None
    return [[str(one)] if isinstance(one, str) else [str(part) for part in one] for one in named if one]


def _there(folder: Path, parts: list[str]) -> Path | None:
    """The file of these names within the folder, in any case of letters; None if it is not there.

    Raises BadInput if a FIFO or a link that leads nowhere is there instead.
    """
    path = folder
    for part in parts:
        spelt = (part, part.lower(), part.upper())
        named = [path / name for name in spelt if name not in ("", ".", "..")]
        found = next((one for one in named if one.exists() or leads_nowhere(one)), None)
        if found is None:
            return None
        check_is_file(found)
        path = found
    return path if path.is_file() else None
