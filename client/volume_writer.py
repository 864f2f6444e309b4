"""Writes volumes through SimpleITK, whole or not at all."""

import importlib
import os
import shutil
import tempfile
from pathlib import Path
from typing import Any

import torch

from volsplat.protocol import matrices
from volsplat.protocol.errors import BadInput
from volsplat.protocol.volume import Geometry

# By extension: whether SimpleITK compresses. NRRD and MetaImage stay raw, so that servers can read sub-cubes.
COMPRESSED = {
    ".nrrd": False,
    ".nhdr": False,
    ".mha": False,
    ".mhd": False,
    ".nii": False,
    ".nii.gz": True,
    ".tif": True,
    ".tiff": True,
}
SHEARLESS = (".nii", ".nii.gz", ".tif", ".tiff")
PAGED = (".tif", ".tiff")  # a slice a page, and nothing that tells one slice from an image
SHEAR_TOLERANCE = 1e-5  # of the cosine between two grid axes


def check_volume_writable(path: Path) -> None:
    """Raises BadInput where `path` has no extension of a volume or cannot be written. Leaves nothing behind."""
    extension_of(path)
    folder = path.parent
    if not folder.is_dir():
        raise BadInput(f"{path}: there is no folder {folder}; make it first")
    if path.is_dir():
        raise BadInput(f"{path}: is a folder; name a file")
    if not os.access(folder, os.W_OK) or path.exists() and not os.access(path, os.W_OK):
        raise BadInput(f"{path}: cannot be written; choose another place or change its permissions")


def extension_of(path: Path) -> str:
    """The extension that decides the format. Raises BadInput for one that is not written."""
    for extension in sorted(COMPRESSED, key=len, reverse=True):
        if path.name.lower().endswith(extension) and len(path.name) > len(extension):
            return extension
    raise BadInput(f"{path}: volumes are not written in this format; name it one of {', '.join(COMPRESSED)}")


def write_volume(path: Path, values: torch.Tensor, geometry: Geometry) -> None:
    """Writes `values`, shaped (k, j, i), with their place in space, taken as LPS, to `path`.

    The files appear under their names only when they are complete. TIFF keeps no place in space but the spacing
    along i and j. Raises BadInput for unknown extensions, for shear or a single slice that the format cannot
    hold, and where the disk refuses.
    """
    check_volume_writable(path)
    extension = extension_of(path)
    if extension in SHEARLESS and _shear(geometry) > SHEAR_TOLERANCE:
        raise BadInput(f"{path}: {extension} would lose the volume's shear; write .nrrd or .mha")
    if extension in PAGED and geometry.dims[2] == 1:
        raise BadInput(f"{path}: {extension} of one slice would be read as an image; write .nrrd or .mha")
    # Here, since whoever writes no volume should not wait for this import.
    simple_itk: Any = importlib.import_module("SimpleITK")
    simple_itk.ProcessObject_SetGlobalWarningDisplay(False)
    image = _placed(simple_itk.GetImageFromArray(values.contiguous().numpy()), geometry)
    try:
        # Beside the target, so that the renaming stays within one file system.
        folder = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    except OSError as error:
        raise BadInput(f"{path}: cannot be written ({os.strerror(error.errno or 0)}); choose another place") from None
    try:
        simple_itk.WriteImage(image, str(folder / path.name), COMPRESSED[extension])
        written_bytes = sum(file.stat().st_size for file in folder.iterdir())
        if not COMPRESSED[extension] and written_bytes < values.nbytes:
            raise BadInput(f"{path}: could not be written whole; the disk may be full")
        # The header last: who finds it finds its data.
        for written in sorted(folder.iterdir(), key=lambda file: file.name == path.name):
            os.replace(written, path.parent / written.name)
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1].strip()
        raise BadInput(f"{path}: cannot be written: {reason}; choose another place or format") from None
    except OSError as error:
        raise BadInput(f"{path}: cannot be written ({os.strerror(error.errno or 0)}); choose another place") from None
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _placed(image: Any, geometry: Geometry) -> Any:
    """SimpleITK's `image` with its place in space."""
    spacing = geometry.spacing
    image.SetSpacing(spacing)
    image.SetOrigin(geometry.origin)
    image.SetDirection([row[axis] / spacing[axis] for row in geometry.index_to_physical for axis in range(3)])
    return image


def _shear(geometry: Geometry) -> float:
    """The greatest cosine between two grid axes."""
    axes = [matrices.normalised(matrices.column(geometry.index_to_physical, axis)) for axis in range(3)]
    return max(abs(matrices.dot(axes[a], axes[b])) for a, b in ((0, 1), (0, 2), (1, 2)))
