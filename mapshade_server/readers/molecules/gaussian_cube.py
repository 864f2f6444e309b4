"""Gaussian cube files: orbitals and densities on a grid, written as text (gaussian.com/cubegen).

The voxels are numbers of any width, x outermost and z fastest, the orbitals of one voxel side by side: so the file is
parsed whole, once, and the axes are exchanged. Lengths become Angstrom, as chemists and the other molecular formats
have them.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from io import BufferedIOBase
from pathlib import Path

import numpy as np

from volsplat.mapshade_server.readers.reading.grids import checked_geometry, refuse_other_dimensions
from volsplat.mapshade_server.readers.reading.gzip_files import is_gzip, unzipped
from volsplat.mapshade_server.readers.reading.parts import Part, PartNeeded
from volsplat.mapshade_server.readers.reading.unpacked_stream import MOST_GROWTH, Packing
from volsplat.mapshade_server.readers.reading.volume_reader import (
    OpenedVolume,
    VolumeFormat,
    Voxels,
    boxes_of,
    packed_or_not,
)
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.volume import Index, VolumeDescription
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix, Vector
from volsplat.protocol.text.errors import BadInput

ANGSTROM_PER_BOHR = 0.529177210903
LONGEST_LINE = 1 << 12
MOST_VALUES_A_VOXEL = 1 << 16
CHUNK_BYTES = 1 << 20
LEAST_BYTES_A_VALUE = 2  # a digit and what parts it from the next

# Fortran leaves the letter out if an exponent has three digits: 1.23456-100.
_BARE_EXPONENT = re.compile(rb"(?<=[\d.])(?=[+-]\d)")

_ORBITAL = re.compile(r"\b(MO|HOMO|LUMO|SOMO|orbitals?|wave ?function)\b", re.IGNORECASE)
_OF_BOTH_SIGNS = re.compile(rf"{_ORBITAL.pattern}|\b(spin|differen|potential|laplacian|gradient)", re.IGNORECASE)
_DENSITY = re.compile(r"\bdensity\b", re.IGNORECASE)


@dataclass(frozen=True)
class _Header:
    """What precedes the voxels; `labels` name the values of one voxel, and `data` is where the voxels start."""

    path: Path
    title: str
    comment: str
    dims: Index
    matrix: Matrix
    origin: Vector
    labels: tuple[str, ...]
    of_orbitals: bool
    data: int


def open_gaussian_cube(path: Path, part: str) -> OpenedVolume:
    """The reader for a cube file; `part` is the number of an orbital, if the file has several.

    Raises BadInput if the header cannot be used or promises more than the file holds.
    """
    with unzipped(path) as file:
        header = _header_of(path, file)
    _check_size(header)
    value = _chosen(header, part)
    density_name = "wave function" if header.of_orbitals else "density"
    kind, kind_from = _kind(header)
    description = VolumeDescription(
        name=path.name,
        format="Gaussian cube" + (f" ({header.title})" if header.title else ""),
        geometry=checked_geometry(path, header.dims, header.matrix, header.origin),
        scalar_type="float32",
        unit="Å",
        kind=kind,
        kind_from=kind_from,
        density_name=f"{density_name} {header.labels[value]}" if len(header.labels) > 1 else density_name,
        up="+z",
        reads_sub_cubes=False,
        why_whole="its voxels are written as text",
    )
    return OpenedVolume(description, boxes_of(lambda: _voxels(header, value)), parts=())


def _kind(header: _Header) -> tuple[Kind, str]:
    """What the file holds by its list of orbitals, else by its two lines of text."""
    if header.of_orbitals:
        return Kind.WAVE_FUNCTION, "its list of orbitals"
    for line in (header.comment, header.title):
        if _OF_BOTH_SIGNS.search(line):  # as a wave function is shown
            return (Kind.WAVE_FUNCTION, f"it says “{line}”") if _ORBITAL.search(line) else (Kind.UNKNOWN, "")
        if _DENSITY.search(line):
            return Kind.ELECTRON_DENSITY, f"it says “{line}”"
    return Kind.UNKNOWN, ""


class _Lines:
    """The header's lines, as the numbers in them."""

    def __init__(self, path: Path, file: BufferedIOBase) -> None:
        self._path = path
        self._file = file

    def text(self) -> str:
        return self._file.readline(LONGEST_LINE).decode("utf-8", "replace").strip()

    def numbers(self, what: str, least: int) -> list[float]:
        """The next line's numbers. Raises BadInput if there are fewer than `least`."""
        try:
            values = [float(word) for word in _with_exponents(self._file.readline(LONGEST_LINE)).split()]
        except ValueError:
            values = []
        if len(values) < least:
            raise self.wrong(f"no {what} where its header should have it")
        return values

    def wrong(self, why: str) -> BadInput:
        return BadInput(f"{self._path}: {why}; it is no Gaussian cube file or a damaged one, export it again")


def _header_of(path: Path, file: BufferedIOBase) -> _Header:
    lines = _Lines(path, file)
    title, comment = lines.text(), lines.text()
    atoms, *origin = lines.numbers("number of atoms and origin", 4)
    axes = [lines.numbers("number of voxels and step of an axis", 4) for _ in range(3)]
    counts = [axis[0] for axis in axes]
    if not all(number.is_integer() for number in (atoms, *counts)) or 0.0 in counts:
        raise lines.wrong("no whole numbers of atoms and voxels in its header")
    in_bohr = counts[0] > 0
    if any((count > 0) != in_bohr for count in counts):
        raise lines.wrong("voxels counted in bohr (a positive number) and in Angstrom (a negative one)")
    for _ in range(abs(int(atoms))):
        lines.numbers("atom", 5)
    labels = _orbitals(lines) if atoms < 0 else _components(lines, origin)
    to_angstrom = ANGSTROM_PER_BOHR if in_bohr else 1.0
    steps: Matrix = tuple((axis[1], axis[2], axis[3]) for axis in axes)  # type: ignore[assignment]
    return _Header(
        path=path,
        title=title,
        comment=comment,
        dims=tuple(abs(int(count)) for count in counts),  # type: ignore[arg-type]
        matrix=matrices.times(matrices.transposed(steps), to_angstrom),
        origin=matrices.scaled((origin[0], origin[1], origin[2]), to_angstrom),
        labels=labels,
        of_orbitals=atoms < 0,
        data=file.tell(),
    )


def _orbitals(lines: _Lines) -> tuple[str, ...]:
    """The numbers of the orbitals, of which a negative number of atoms gives notice."""
    words = lines.numbers("list of orbitals", 1)
    count = _values_a_voxel(lines, words[0])
    while len(words) < 1 + count:
        words += lines.numbers("list of orbitals", 1)
    if len(words) > 1 + count:
        raise lines.wrong(f"more orbitals than the {count} that its header counts")
    labels = tuple(f"{word:.0f}" for word in words[1:])
    return labels if len(set(labels)) == count else _numbered(count)


def _components(lines: _Lines, origin: list[float]) -> tuple[str, ...]:
    """The numbers of the values of a voxel, counted behind the origin if there are several."""
    return _numbered(_values_a_voxel(lines, origin[3]) if len(origin) > 3 else 1)


def _values_a_voxel(lines: _Lines, stated: float) -> int:
    if not stated.is_integer() or not 1 <= stated <= MOST_VALUES_A_VOXEL:
        raise lines.wrong(f"{stated:g} values a voxel by its header")
    return int(stated)


def _numbered(count: int) -> tuple[str, ...]:
    return tuple(str(n + 1) for n in range(count))


def _check_size(header: _Header) -> None:
    """Raises BadInput if there are fewer than three axes, or the file cannot hold what the header promises."""
    ni, nj, nk = header.dims
    if min(header.dims) == 1:
        refuse_other_dimensions(header.path, tuple(n for n in header.dims if n > 1) or (1,))
    zipped = is_gzip(header.path)
    there = header.path.stat().st_size * (MOST_GROWTH[Packing.DEFLATE] if zipped else 1) - header.data
    if (promised := ni * nj * nk * len(header.labels)) * LEAST_BYTES_A_VALUE > there + 1:
        raise BadInput(
            f"{header.path}: the header promises {promised} numbers, but the file holds only {max(there, 0)} bytes of "
            "them; it is truncated or the header's sizes are wrong"
        )


def _chosen(header: _Header, part: str) -> int:
    """Which of a voxel's values is meant."""
    if part in header.labels:
        return header.labels.index(part)
    what = "orbitals" if header.of_orbitals else "values a voxel"
    listed = ", ".join(header.labels)
    if part:
        raise BadInput(f"{header.path}: has no part “{part}”; its {what} are {listed}")
    if len(header.labels) > 1:
        line = (
            f"{header.path}: has {len(header.labels)} {what}: {listed}; "
            f"choose one, as in {header.path.name}#{header.labels[0]}"
        )
        one = "orbital" if header.of_orbitals else "value"
        raise PartNeeded(line, [Part(label, f"{one} {label}") for label in header.labels])
    return 0


def _voxels(header: _Header, value: int) -> Voxels:
    """The chosen values of all voxels, as float32: the file prints six digits of them."""
    ni, nj, nk = header.dims
    stride = len(header.labels)
    promised = ni * nj * nk * stride
    voxels = np.empty(ni * nj * nk, np.float32)
    seen = 0
    with unzipped(header.path) as file:
        file.seek(header.data)
        for numbers in _numbers(header.path, file):
            wanted = numbers[(value - seen) % stride :: stride]
            if seen + len(numbers) > promised:
                raise BadInput(
                    f"{header.path}: holds more numbers than the {promised} that its header promises; "
                    "the header's sizes are wrong, export it again"
                )
            first = (seen - value + stride - 1) // stride
            voxels[first : first + len(wanted)] = wanted
            seen += len(numbers)
    if seen < promised:
        raise BadInput(
            f"{header.path}: is truncated, it ends after {seen} of its {promised} numbers; fetch or export it again"
        )
    return np.ascontiguousarray(voxels.reshape(ni, nj, nk).transpose(2, 1, 0))


def _numbers(path: Path, file: BufferedIOBase) -> Iterator[Voxels]:
    """The numbers of the rest of the file, some at a time."""
    rest = b""
    while chunk := file.read(CHUNK_BYTES):
        whole = rest + chunk
        end = max(whole.rfind(b"\n"), whole.rfind(b" ")) + 1
        rest = whole[end:]
        if len(rest) > LONGEST_LINE:
            break
        yield _parsed(path, whole[:end])
    yield _parsed(path, rest)


def _parsed(path: Path, text: bytes) -> Voxels:
    try:
        return _floats(text)
    except ValueError:
        pass
    try:
        return _floats(_with_exponents(text))
    except ValueError as error:
        word = str(error).partition(": ")[2][:40]
        raise BadInput(f"{path}: has {word} where a voxel should be; fetch or export the file again") from None


def _floats(text: bytes) -> Voxels:
    words = text.split()
    with np.errstate(over="ignore"):  # what is beyond float32 is as good as infinite
        return np.fromiter(map(float, words), np.float32, len(words))


def _with_exponents(text: bytes) -> bytes:
    """Fortran's spellings of exponents, 1.0D-05 and 1.0-100, turned into 1.0E-05 and 1.0E-100."""
    return _BARE_EXPONENT.sub(b"E", text.replace(b"D", b"E").replace(b"d", b"e"))


FORMATS = (
    VolumeFormat("Gaussian cube (.cube)", open_gaussian_cube, extensions=packed_or_not(".cube", ".cub"), gzip=True),
)
