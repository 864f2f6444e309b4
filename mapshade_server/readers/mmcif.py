"""mmCIF files (.cif, .mmcif, also .ent and gzip): the coordinates of atoms, or structure factors, told apart here."""

import re
from pathlib import Path
from typing import Any

from volsplat.mapshade_server.readers import atoms
from volsplat.mapshade_server.readers.extra import library
from volsplat.mapshade_server.readers.unzipped_text import unzipped_text
from volsplat.mapshade_server.readers.volume_reader import VolumeReader
from volsplat.protocol.errors import BadInput

EXTENSIONS = (".cif", ".mmcif", ".cif.gz", ".mmcif.gz")


def recognises(head: bytes) -> bool:
    return re.match(rb"(\s*#[^\n]*\n|\s+)*data_\S", head) is not None


def open_mmcif(path: Path, part: str) -> VolumeReader:
    """The reader for what an mmCIF file holds. Raises BadInput where that is neither atoms nor structure factors."""
    blocks = list(_document(path))
    with_atoms = [block for block in blocks if block.find_values("_atom_site.Cartn_x")]
    if with_atoms:
        structure = library("gemmi", "an mmCIF file").make_structure_from_block(with_atoms[0])
        return atoms.open_structure(path, part, "mmCIF", structure, [])
    if any(block.find_values("_atom_site_fract_x") for block in blocks):
        raise BadInput(f"{path}: a CIF of a small molecule, with atoms as fractions of its cell; convert it to mmCIF")
    raise BadInput(f"{path}: an mmCIF file without atoms; give one with coordinates")


def _document(path: Path) -> Any:
    gemmi = library("gemmi", "an mmCIF file")
    try:
        return gemmi.cif.read_string(unzipped_text(path))
    except ValueError as error:
        reason = str(error).partition("\n")[0].removeprefix("string:")
        raise BadInput(f"{path}: is no mmCIF file or a damaged one, at {reason}; fetch it again") from None
