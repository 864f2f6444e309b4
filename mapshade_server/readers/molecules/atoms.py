"""Molecules by the coordinates of their atoms, in PDB files (.pdb, .ent, also gzip), PQR and mmCIF, through gemmi.

They become voxels by atom_density, in the coordinates' own axes and Å, so that a map of the same molecule lies in the
same place; or by calculated_factors, in the dimensions of frequency. After `#`, parted by commas: `elements` (if
nothing is said), `density`, `frequency` or `amplitude`; the spacing of the grid, or the resolution, in Å;
`waters=keep`, which are left out else; `model=2`, else the first. As in `4hhb.pdb#density,0.5,waters=keep` and in
`1jk9.pdb#frequency`.
"""

import math
import re
from pathlib import Path
from typing import Any

import numpy as np

from volsplat.mapshade_server.readers.molecules.atom_density import (
    BAND,
    BOND_CLASS,
    CLASSES,
    OTHER_CLASS,
    AtomGrid,
    Atoms,
    chosen_spacing,
    grid_around,
)
from volsplat.mapshade_server.readers.molecules.calculated_factors import calculated_reflections
from volsplat.mapshade_server.readers.molecules.gemmi_errors import one_line_errors
from volsplat.mapshade_server.readers.molecules.pqr import is_pqr, pqr_structure
from volsplat.mapshade_server.readers.molecules.structure_factors import open_reflections
from volsplat.mapshade_server.readers.reading.extra import library
from volsplat.mapshade_server.readers.reading.gzip_files import unzipped_text
from volsplat.mapshade_server.readers.reading.part_options import part_options
from volsplat.mapshade_server.readers.reading.parts import Part
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume, VolumeFormat, packed_or_not
from volsplat.protocol.description.kind import Band, Kind
from volsplat.protocol.description.volume import Geometry, VolumeDescription
from volsplat.protocol.text.errors import BadInput

IN_FREQUENCY = ("frequency", "amplitude")
KINDS = {
    "elements": "a colour for each element, and bonds",
    "density": "a synthetic electron density",
    "frequency": "calculated structure factors, with phases",
    "amplitude": "calculated structure factors",
}
MOST_VOXELS_ASIDE = 4096

_RECORDS = (
    "HEADER|OBSLTE|TITLE |SPLIT |CAVEAT|COMPND|SOURCE|KEYWDS|EXPDTA|NUMMDL|MDLTYP|AUTHOR|REVDAT|SPRSDE|JRNL  |REMARK|"
    "DBREF |SEQRES|CRYST1|MODEL |ATOM  |HETATM"
)
_FIRST_RECORD = re.compile(rf"\s*({_RECORDS})[ 0-9]".encode())
_COORDINATES = r"(?: {0,23}-?[0-9]{1,23}\.[0-9]{0,23}){3}"  # within 24 columns: a line may have millions
_BROKEN_ATOM = re.compile(rf"^(?:ATOM  |HETATM)(?!.{{24}}{_COORDINATES})", re.MULTILINE)
_END = re.compile(r"^END *\r?$", re.MULTILINE)
_BANDS = tuple(Band(name, max(n * BAND, 1), (n + 1) * BAND - 1) for n, name in enumerate(CLASSES))


def open_pdb(path: Path, part: str) -> OpenedVolume:
    """The reader for a PDB or PQR file. Raises BadInput."""
    text = unzipped_text(path)
    if is_pqr(path, text):
        told = ["the charges and radii of PQR are not drawn: atoms are drawn by their elements, told by their names"]
        return open_structure(path, part, "PQR", pqr_structure(path, text), told)
    if broken := _BROKEN_ATOM.search(text):  # gemmi would take what is no number for 0
        line = text.count("\n", 0, broken.start()) + 1
        raise BadInput(f"{path}: line {line} has no three coordinates where a PDB file has them; fetch it again")
    gemmi = library("gemmi", "a PDB file")
    with one_line_errors(path, "PDB file"):
        structure = gemmi.read_pdb_string(text)
    warnings = [] if _END.search(text) else ["the file has no END record; it may be truncated"]
    return open_structure(path, part, "PDB", structure, warnings)


def open_structure(path: Path, part: str, name: str, structure: Any, warnings: list[str]) -> OpenedVolume:
    """The reader for the atoms of gemmi's structure, from a file in the format `name`. Raises BadInput."""
    word, options = part_options(part, ("waters", "model"))
    kind, fineness = _kind_and_fineness(path, word)
    model = _model(path, structure, options.get("model"), part or kind, warnings)
    if options.get("waters", "leave") not in ("leave", "keep"):
        raise BadInput(f"{path}: “waters={options['waters']}” is neither waters=keep nor waters=leave")
    waters = sum(residue.is_water() for chain in model for residue in chain)
    if waters and options.get("waters") != "keep":
        warnings.append(f"{waters} waters are left out; {path.name}#{part or kind},waters=keep keeps them")
        model.remove_waters()
    atoms = _atoms(path, model, warnings)
    if kind in IN_FREQUENCY:
        reflections = calculated_reflections(path, structure, model, fineness, warnings)
        return open_reflections(reflections, f"{name}, {len(atoms.radii)} atoms", kind)
    geometry = _geometry(path, kind, atoms, chosen_spacing(atoms) if fineness is None else fineness)
    if atoms.crowded:
        raise BadInput(
            f"{path}: its {len(atoms.radii)} atoms lie in too few places, as where coordinates are placeholders; "
            "give a file with coordinates"
        )
    elements = kind == "elements"
    drawn = "by element" if elements else "as a synthetic electron density"
    description = VolumeDescription(
        name=path.name,
        format=f"{name}, {len(atoms.radii)} atoms {drawn}",
        geometry=geometry,
        scalar_type="uint8" if elements else "float32",
        unit="Å",
        kind=Kind.ELEMENTS if elements else Kind.ATOM_DENSITY,
        kind_from="it is made of atoms",
        bands=_BANDS if elements else (),
        density_name="element" if elements else "synthetic density",
        warnings=tuple(warnings),
        up="+z",
        why_whole="the list of atoms is read whole, but only a sub-cube's own voxels are made of it",
    )
    grid = AtomGrid(atoms, geometry)
    parts = [] if part else _parts(structure)
    return OpenedVolume(description, grid.elements if elements else grid.density, parts=parts)


def _parts(structure: Any) -> list[Part]:
    """What can be made of the first model, and the others."""
    others = [str(model.num) for model in structure][1:]
    return [
        *(Part(kind, told) for kind, told in KINDS.items()),
        *(Part(f"model={number}", f"the elements of model {number}") for number in others),
    ]


def _kind_and_fineness(path: Path, word: str) -> tuple[str, float | None]:
    """What to make of the atoms, and the spacing or the resolution in Å if it is stated. Raises BadInput."""
    words = [text.strip() for text in word.split(",")] if word else []
    kind = words.pop(0) if words and words[0] in KINDS else next(iter(KINDS))
    if not words:
        return kind, None
    try:
        (fineness,) = (float(text) for text in words)
    except ValueError:
        raise BadInput(
            f"{path}: has no part “{word}”; it is {', '.join(KINDS)}, then a spacing or resolution in Å, as in "
            f"{path}#{kind},{'2' if kind in IN_FREQUENCY else '0.5'}"
        ) from None
    if not 0 < fineness < math.inf:
        raise BadInput(f"{path}: a spacing of {fineness:g} Å cannot be; give one above 0")
    return kind, fineness


def _model(path: Path, structure: Any, wanted: str | None, said: str, warnings: list[str]) -> Any:
    """The model of this number, else the first; `said` is what stands after `#`. Raises BadInput."""
    models = {str(model.num): model for model in structure}
    if not models:
        raise BadInput(f"{path}: has no atoms; give a file with coordinates")
    first = next(iter(models))
    if wanted is not None and wanted not in models:
        raise BadInput(f"{path}: has no model {wanted}; its models are {_listed(list(models))}")
    if wanted is None and len(models) > 1:
        warnings.append(f"of {len(models)} models the first is shown; {path.name}#{said},model=N shows another")
    return models[wanted or first]


def _listed(numbers: list[str]) -> str:
    return ", ".join(numbers) if len(numbers) < 10 else f"{numbers[0]} to {numbers[-1]}"


def _atoms(path: Path, model: Any, warnings: list[str]) -> Atoms:
    every = [atom for chain in model for residue in chain for atom in residue]
    known = [atom for atom in every if atom.element.atomic_number > 0]
    if not known:
        raise BadInput(f"{path}: has no atoms; give a file with coordinates")
    if len(known) < len(every):
        warnings.append(f"{len(every) - len(known)} atoms of no known element are left out")
    places = np.array([atom.pos.tolist() for atom in known])
    occupancies = np.array([atom.occ for atom in known])
    if not (np.isfinite(places).all() and np.isfinite(occupancies).all()):
        raise BadInput(f"{path}: an atom's coordinates or occupancy are not numbers; correct the file")
    if not occupancies.any():
        warnings.append("all atoms have the occupancy 0; it is taken as 1")
        occupancies[:] = 1.0
    return Atoms(
        places=places,
        radii=np.array([round(atom.element.covalent_r, 4) for atom in known]),  # gemmi has them in float32
        heights=np.array([float(atom.element.atomic_number) for atom in known]) * np.clip(occupancies, 0.0, 1.0),
        classes=np.array([_element_class(atom.element) for atom in known]),
        alternatives=np.array([ord(atom.altloc) for atom in known]),
    )


def _element_class(element: Any) -> int:
    name = "H" if element.is_hydrogen else element.name
    found = CLASSES.index(name) if name in CLASSES else OTHER_CLASS
    return OTHER_CLASS if found == BOND_CLASS else found


def _geometry(path: Path, kind: str, atoms: Atoms, spacing: float) -> Geometry:
    extent = float((atoms.places.max(axis=0) - atoms.places.min(axis=0)).max())
    if extent / spacing > MOST_VOXELS_ASIDE:
        least = float(f"{1.1 * extent / MOST_VOXELS_ASIDE:.1e}")
        raise BadInput(
            f"{path}: its atoms lie {extent:g} Å apart, too far for a spacing of {spacing:g} Å; "
            f"give at least {least:g}, as in {path}#{kind},{least:g}"
        )
    return grid_around(atoms, spacing)


FORMATS = (
    VolumeFormat(
        "PDB or PQR coordinates (.pdb, .pqr)",
        open_pdb,
        lambda head: _FIRST_RECORD.match(head) is not None,
        packed_or_not(".pdb", ".ent", ".pqr"),
        gzip=True,
    ),
)
