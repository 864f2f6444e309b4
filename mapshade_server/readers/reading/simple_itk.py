"""SimpleITK for the readers: imported on first use, silent, its exceptions turned into one line."""

import importlib
import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from volsplat.mapshade_server.readers.reading.grids import checked_geometry
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box, Geometry
from volsplat.protocol.text.errors import BadInput


@cache
def simple_itk() -> ModuleType:
    """The SimpleITK module. It takes a quarter of a second to import, which only its formats should pay."""
    module = importlib.import_module("SimpleITK")
    module.ProcessObject_SetGlobalWarningDisplay(False)
    return module


@contextmanager
def one_line_errors(path: Path) -> Iterator[None]:
    """Turns SimpleITK's exceptions, of several lines and source positions, into BadInput."""
    try:
        yield
    except RuntimeError as error:
        raise BadInput(f"{path}: cannot be read: {_reason(str(error))}; check or export the volume again") from None


def _reason(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    told = [line for line in lines if not line.startswith("Exception thrown")] or lines
    reason = re.sub(r"^(sitk|ITK) ?::ERROR: |^ITK ERROR: ", "", " ".join(told))
    reason = re.sub(r"\w+\(0x[0-9a-f]+\): ", "", reason)
    return reason.rstrip(".!; ")


def header_of(path: Path, image_io: str) -> Any:
    """SimpleITK's ImageFileReader for `path` with the image information read. Raises BadInput."""
    reader = simple_itk().ImageFileReader()
    reader.SetImageIO(image_io)
    reader.SetFileName(str(path))
    with one_line_errors(path):
        reader.ReadImageInformation()
    return reader


def geometry_of(path: Path, reader: Any) -> Geometry:
    """Spacing, direction and origin of the first three axes; physical axes are LPS, as SimpleITK has it."""
    size, spacing, origin = reader.GetSize(), reader.GetSpacing(), reader.GetOrigin()
    direction, n = reader.GetDirection(), len(reader.GetSize())
    rows = [[direction[n * row + axis] * spacing[axis] for axis in range(3)] for row in range(3)]
    return checked_geometry(path, size[:3], rows, origin[:3])


def extracted(path: Path, reader: Any, box: Box) -> Voxels:
    """The voxels of `box` by SimpleITK's extract, which reads more than them."""
    more_axes = len(reader.GetSize()) - 3
    reader.SetExtractIndex([*box.low, *[0] * more_axes])
    reader.SetExtractSize([*box.size, *[0] * more_axes])
    with one_line_errors(path):
        voxels: Voxels = simple_itk().GetArrayFromImage(reader.Execute())
    return voxels
