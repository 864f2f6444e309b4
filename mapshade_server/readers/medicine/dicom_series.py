"""DICOM: the series of a folder, told apart and chosen by name, and files of several frames or of one.

`scans/#T2_AX`, by the series' description, `scans/#4`, by its number, `scans/#1.2.840`, by how its UID begins; if
one series holds several volumes, `scans/#4,echo=2,time=3`. A file of a single slice, `scans/IM0001`, stands for the
series around it, and `scans/IM0001#slice` for itself.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NoReturn

from volsplat.mapshade_server.readers.medicine import dicom_stack
from volsplat.mapshade_server.readers.medicine.dicom_file import DicomFile, Frame, dicom_file, recognises
from volsplat.mapshade_server.readers.medicine.dicom_folder import image_if_readable, images_of, series_of
from volsplat.mapshade_server.readers.medicine.dicom_stack import Stack
from volsplat.mapshade_server.readers.medicine.dicom_values import scalar_type_of
from volsplat.mapshade_server.readers.medicine.modality import kind_of_modality
from volsplat.mapshade_server.readers.reading.part_options import PartOptions, part_options
from volsplat.mapshade_server.readers.reading.volume_files import disk_files
from volsplat.mapshade_server.readers.reading.volume_reader import FolderFormat, OpenedVolume, VolumeFormat
from volsplat.protocol.description.volume import VolumeDescription
from volsplat.protocol.text.errors import BadInput

MOST_TOLD = 5000  # files that are looked at to tell which series there are
ONE_SLICE = "slice"  # the part of a name that means a single slice alone


@dataclass(frozen=True)
class _Series:
    """The files of one series, in the order of their names."""

    files: tuple[DicomFile, ...]

    @property
    def frames(self) -> list[Frame]:
        return [frame for file in self.files for frame in file.frames]

    @property
    def is_scout(self) -> bool:
        """A picture to plan by, or a screen shot, that nobody means by the volume of a folder."""
        first = self.files[0]
        placed = first.ordered or any(frame.place is not None for frame in self.frames)
        return len(self.frames) < 2 or first.localizer or not placed

    @property
    def title(self) -> str:
        first = self.files[0]
        number = first.series_number or "without number"
        return f"{number} “{first.series_description}”" if first.series_description else number

    @property
    def told(self) -> str:
        if not self.frames:
            return f"{self.title}, in colour or no plain pixels"
        pixels, count = self.frames[0].pixels, len(self.frames)
        return f"{self.title}, {count} slice{'s' * (count > 1)} of {pixels.columns} x {pixels.rows}"

    def answers_to(self, word: str) -> bool:
        first = self.files[0]
        described = first.series_description.lower() == word.lower()
        return described or first.series_number == word or "." in word and first.series_uid.startswith(word)


def open_dicom_file(path: Path, part: str) -> OpenedVolume:
    """The reader for a file of several frames, for the series around a single slice, or for `#slice` alone.

    Raises BadInput if the slice has no others beside it, and for a DICOMDIR without images.
    """
    file = dicom_file(path)
    if file is None:
        return open_folder(path.parent, part) if path.name.upper().startswith("DICOMDIR") else _no_image(path)
    said = part_options(part, dicom_stack.KEYS)
    if len(file.frames) == 1 and not file.refusal:
        return _alone(path, file) if part == ONE_SLICE else _around(path, file, said)
    series = _Series((file,))
    if said.word and not series.answers_to(said.word):
        raise BadInput(f"{path}: holds series {series.title}, none called “{said.word}”")
    return _reader(path, series, said)


def _no_image(path: Path) -> NoReturn:
    raise BadInput(f"{path}: a DICOM file without an image; give a file of several frames, or a series' folder")


def _around(path: Path, slice_: DicomFile, said: PartOptions) -> OpenedVolume:
    """The series, and of several volumes in it the one, that a single slice belongs to."""
    series = _Series(tuple(series_of(path, slice_.series_uid)))
    if said.word and not series.answers_to(said.word):
        raise BadInput(f"{path}: is of series {series.title}, not of “{said.word}”; {path}#{ONE_SLICE} draws it alone")
    if len(series.files) == 1:
        raise BadInput(
            f"{path}: one DICOM slice, a 2-D image, and no other of its series lies beside it; give the folder of the "
            f"whole series, or {path}#{ONE_SLICE} for it alone"
        )
    if not said.values:
        groups = dicom_stack.apart(path, series.frames)
        its = (name for name, frames in groups.items() if any(frame.pixels.path == path for frame in frames))
        said = PartOptions(said.word, dict(next(its, ())))
    told = f"{path.name} is one slice of the series that is drawn; {path.name}#{ONE_SLICE} draws it alone"
    return _reader(path, series, said, (told,))


def _alone(path: Path, file: DicomFile) -> OpenedVolume:
    stack = dicom_stack.single(path, file.frames[0])
    return _opened(f"{path.name}#{ONE_SLICE}", _Series((file,)), stack)


def open_folder(folder: Path, part: str) -> OpenedVolume:
    """The reader for the series in `folder` that is named or, of several, the only one that is a volume.

    Raises BadInput if there is none, if one must be named, and if slices are damaged or do not fit together.
    """
    every = _all_series(folder)
    said = part_options(part, dicom_stack.KEYS)
    series = _chosen(folder, every, said.word)
    return _reader(folder, series, said, () if said.word else _left_out(every, series))


def _all_series(folder: Path) -> list[_Series]:
    """The series of all images of the folder."""
    return _of_files(images_of(folder))


def _of_files(files: Iterable[DicomFile]) -> list[_Series]:
    by_uid: dict[str, list[DicomFile]] = {}
    for file in files:
        by_uid.setdefault(file.series_uid, []).append(file)
    return [_Series(tuple(one)) for one in by_uid.values()]


def _chosen(folder: Path, every: Sequence[_Series], word: str) -> _Series:
    """The series that is named or, if none is, the only one that is a volume."""
    named = [series for series in every if series.answers_to(word)] if word else list(every)
    named = [series for series in named if series.files[0].series_uid == word] or named
    if not named:
        raise BadInput(f"{folder}: no series is called “{word}”; {_how_to_choose(folder, every)}")
    volumes = [series for series in named if not series.is_scout] or named
    if len(volumes) == 1:
        return volumes[0]
    called = f" called “{word}”" if word else ""
    scouts = ", all of them single slices or localizers" if volumes[0].is_scout else ""
    raise BadInput(f"{folder}: holds {len(named)} series{called}{scouts}; {_how_to_choose(folder, volumes)}")


def _how_to_choose(folder: Path, every: Sequence[_Series]) -> str:
    """The series, and how to choose one: by what tells all of them apart."""
    told = [series.told for series in every]
    if words := _apart_by_words(every):
        return f"choose one of {'; '.join(told)}; as in {folder}#{words[0]}"
    files = [series.files[0] for series in every]
    told = [f"{text}, UID {file.series_uid}" for text, file in zip(told, files, strict=True)]
    return f"choose one of {'; '.join(told)}; by how its UID begins, as in {folder}#{files[0].series_uid}"


def _apart_by_words(every: Sequence[_Series]) -> list[str]:
    """A word for each of the series, if numbers or descriptions tell them apart."""
    files = [series.files[0] for series in every]
    for words in ([file.series_number for file in files], [file.series_description for file in files]):
        if all(words) and len(set(words)) == len(words):
            return words
    return []


def told_series(images: Sequence[Path]) -> list[tuple[str, str]]:
    """The volumes that these DICOM files of one folder make: the part of its name that means each, and what it is.

    What is damaged or no image is left out; so are single slices.
    """
    readable = (image_if_readable(path) for path in images[:MOST_TOLD])
    every = _of_files(file for file in readable if file is not None)
    told = list[tuple[str, str]]()
    for series, word in zip(every, _parts(every), strict=True):
        groups = _volumes(series)
        for name, frames in groups.items():
            chosen = [f"{key}={value}" for key, value in name] if len(groups) > 1 else []
            pixels = frames[0].pixels
            slices = f"{len(frames)} slices of {pixels.columns} x {pixels.rows}"
            part = ",".join([word, *chosen] if word else chosen)
            told.append((part, ", ".join([f"series {series.title}", *chosen, slices])))
    return told


def _volumes(series: _Series) -> dicom_stack.Groups:
    """The groups of its frames that may be volumes, none if it is turned in too many ways to be stacks."""
    try:
        groups = dicom_stack.apart(series.files[0].path, series.frames)
    except BadInput:
        return {}
    return {name: frames for name, frames in groups.items() if len(frames) > 1}


def _parts(every: Sequence[_Series]) -> list[str]:
    """How each series is named: the only volume of a folder by the folder's name alone."""
    words = _apart_by_words(every)
    if not all(word.isdecimal() for word in words) or not words:
        words = [series.files[0].series_uid for series in every]
    volumes = [series for series in every if not series.is_scout]
    return ["" if volumes == [series] else word for series, word in zip(every, words, strict=True)]


def _left_out(every: Sequence[_Series], chosen: _Series) -> tuple[str, ...]:
    others = [series.told for series in every if series is not chosen]
    return (f"of the folder this series is drawn; left out: {'; '.join(others)}",) if others else ()


def _reader(source: Path, series: _Series, said: PartOptions, warnings: tuple[str, ...] = ()) -> OpenedVolume:
    if refusal := next((file.refusal for file in series.files if file.refusal), ""):
        raise BadInput(refusal)
    groups = dicom_stack.apart(source, series.frames)
    name, frames = _chosen_group(source, groups, said)
    stack = dicom_stack.stacked(source, frames, series.files[0])
    values = ",".join([*([said.word] if said.word else []), *(f"{key}={value}" for key, value in name)])
    shown = f"{source.resolve().name}#{values}" if values else source.resolve().name
    return _opened(shown, series, stack, warnings)


def _opened(name: str, series: _Series, stack: Stack, warnings: tuple[str, ...] = ()) -> OpenedVolume:
    first = series.files[0]
    kind, kind_from = kind_of_modality(first.modality)
    pixels = stack.frames[0].pixels
    description = VolumeDescription(
        name=name,
        format=f"DICOM {first.modality} series {series.title}",
        geometry=stack.geometry,
        chunk=(pixels.columns, pixels.rows if pixels.fragments else 1, 1),
        scalar_type=scalar_type_of([(frame.pixels, frame.rescale) for frame in stack.frames]),
        unit=stack.unit,
        value_unit=first.value_unit,
        anatomical=stack.anatomical,
        kind=kind,
        kind_from=kind_from,
        warnings=(*warnings, *stack.warnings, *first.told),
    )
    paths = [frame.pixels.path for frame in stack.frames]
    return OpenedVolume(description, partial(stack.read, description.scalar_type), lambda: disk_files(paths), parts=())


def _chosen_group(source: Path, groups: dicom_stack.Groups, said: PartOptions) -> tuple[dicom_stack.Name, list[Frame]]:
    """The frames that are meant, of one series. Raises BadInput if it is not said which."""
    there = dicom_stack.choices(groups)
    for key, value in said.values.items():
        if value not in there.get(key, ()):
            told = dicom_stack.told({key: there[key]}) if key in there else "it has nothing to choose by that"
            raise BadInput(f"{source}: the series has no {key}={value}: {told}")
    left = {name: frames for name, frames in groups.items() if said.values.items() <= dict(name).items()}
    if not left:
        raise BadInput(f"{source}: the series has no volume of {','.join(f'{k}={v}' for k, v in said.values.items())}")
    volumes = {name: frames for name, frames in left.items() if len(frames) > 1}
    if not volumes:
        count = sum(len(frames) for frames in left.values())
        what = "one slice" if count == 1 else f"{count} single slices that do not belong together"
        raise BadInput(f"{source}: a 2-D image, volsplat needs a volume: the series has {what}; give all its slices")
    if len(volumes) > 1:
        example = ",".join(
            [*([said.word] if said.word else []), *(f"{key}={value}" for key, value in next(iter(volumes)))]
        )
        told = dicom_stack.told(dicom_stack.choices(volumes))
        raise BadInput(f"{source}: the series holds {len(volumes)} volumes, {told}; choose, as in {source}#{example}")
    return next(iter(volumes.items()))


FORMATS = (VolumeFormat("DICOM series (a folder)", open_dicom_file, recognises, parts=False),)
FOLDER_FORMAT = FolderFormat("DICOM series", open_folder, lambda folder: True)
