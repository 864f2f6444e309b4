"""mmCIF files (.cif, .mmcif, also .ent and gzip): the coordinates of atoms, or structure factors."""

import re
from pathlib import Path
from typing import Any

from volsplat.mapshade_server.readers.molecules import atoms, structure_factors
from volsplat.mapshade_server.readers.molecules.gemmi_errors import one_line_errors
from volsplat.mapshade_server.readers.reading.extra import library
from volsplat.mapshade_server.readers.reading.gzip_files import unzipped_text
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume, VolumeFormat, packed_or_not
from volsplat.protocol.text.errors import BadInput

REFLECTIONS = ("_refln", "_diffrn_refln")

# Possessive, so that thousands of blanks before something else are passed over once.
_FIRST_BLOCK = re.compile(rb"(?:\s++|#[^\n]*+\n)*+data_\S")


def open_mmcif(path: Path, part: str) -> OpenedVolume:
    """The reader for what an mmCIF file holds. Raises BadInput if that is neither atoms nor structure factors."""
    document = _document(path)
    blocks = list(document)
    with_atoms = [block for block in blocks if block.find_values("_atom_site.Cartn_x")]
    if with_atoms:
        with one_line_errors(path, "mmCIF file"):
            structure = library("gemmi", "an mmCIF file").make_structure_from_block(with_atoms[0])
        return atoms.open_structure(path, part, "mmCIF", structure, [])
    if any(block.find_values(f"{category}.index_h") for block in blocks for category in REFLECTIONS):
        return structure_factors.open_mmcif_reflections(path, part, document)
    if any(block.find_values("_atom_site_fract_x") for block in blocks):
        raise BadInput(f"{path}: a CIF of a small molecule, with atoms as fractions of its cell; convert it to mmCIF")
    raise BadInput(f"{path}: an mmCIF file without atoms or reflections; give one with either")


def _document(path: Path) -> Any:
    gemmi = library("gemmi", "an mmCIF file")
    text = unzipped_text(path)
    with one_line_errors(path, "mmCIF file"):
        return gemmi.cif.read_string(text)


FORMATS = (
    VolumeFormat(
        "mmCIF (.cif)",
        open_mmcif,
        lambda head: _FIRST_BLOCK.match(head) is not None,
        packed_or_not(".cif", ".mmcif"),
        gzip=True,
    ),
)
