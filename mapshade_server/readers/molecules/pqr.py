"""PQR files: atoms as in PDB files, with a charge and a radius where those have occupancy and B factor (pdb2pqr).

Fields are parted by spaces, the chain may be missing, and no element is named: it is told by the atom's name. Some
programs keep PDB's columns instead, so that numbers may touch.
"""

import math
import re
from pathlib import Path
from typing import Any, NamedTuple

from volsplat.mapshade_server.readers.reading.extra import library
from volsplat.protocol.text.errors import BadInput

EXTENSIONS = (".pqr", ".pqr.gz")

_REMARK = re.compile(r"^REMARK.*\bPQR\b", re.MULTILINE)
_ATOM = re.compile(r"^(ATOM|HETATM)(.*)$", re.MULTILINE)
_NEGATIVE_OCCUPANCY = re.compile(r"^(?:ATOM|HETATM).*[ 0-9]-[0-9.]+ +[0-9]+\.[0-9]+ *\r?$", re.MULTILINE)
_CHARGE_SIGN = re.compile(r"[0-9]*[+-]?$")
_TWO_LETTERS = ("BR", "CL", "CU", "FE", "MG", "MN", "SE", "ZN")  # no atom of carbon, nitrogen, ... is called so


class PqrAtom(NamedTuple):
    name: str
    residue: str
    chain: str
    number: int
    place: tuple[float, float, float]  # Å


def is_pqr(path: Path, text: str) -> bool:
    """Whether text that begins as PDB does is PQR: by its name, its remarks, or charges instead of occupancies."""
    named = path.name.lower().endswith(EXTENSIONS)
    return named or _REMARK.search(text) is not None or _NEGATIVE_OCCUPANCY.search(text) is not None


def pqr_structure(path: Path, text: str) -> Any:
    """gemmi's structure of the atoms in PQR text. Raises BadInput if an atom has not all its numbers."""
    gemmi = library("gemmi", "a PQR file")
    structure, model = gemmi.Structure(), gemmi.Model(1)
    chain = residue = None
    for found in _ATOM.finditer(text):
        atom = _atom(found[0], found[2])
        if atom is None:
            line = text.count("\n", 0, found.start()) + 1
            raise BadInput(f"{path}: line {line} has no place, charge and radius as PQR has them; export it again")
        if chain is None or chain.name != atom.chain:
            chain, residue = model.add_chain(gemmi.Chain(atom.chain)), None
        if residue is None or (residue.name, residue.seqid.num) != (atom.residue, atom.number):
            residue = chain.add_residue(_residue(gemmi, atom))
        residue.add_atom(_gemmi_atom(gemmi, atom))
    structure.add_model(model)
    return structure


def _atom(line: str, fields: str) -> PqrAtom | None:
    """The atom of a line with these fields behind its first word, None if that is none."""
    words = fields.split()
    numbers = _numbers(words[-5:])
    if numbers and len(words) in (9, 10):
        return _placed(words[1], words[2], words[3] if len(words) == 10 else "", words[-6], numbers)
    numbers = _numbers([line[30:38], line[38:46], line[46:54], *line[54:].split()])
    return _placed(line[12:16], line[17:20], line[21:22], line[22:27], numbers) if numbers else None


def _numbers(words: list[str]) -> list[float]:
    """A place, a charge and a radius, [] if the words are not these."""
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        return []
    return numbers if len(numbers) == 5 and all(map(math.isfinite, numbers)) else []


def _placed(name: str, residue: str, chain: str, number: str, numbers: list[float]) -> PqrAtom:
    digits = re.match(r"\s*-?[0-9]+", number)
    place = (numbers[0], numbers[1], numbers[2])
    return PqrAtom(name.strip(), residue.strip(), chain.strip(), int(digits[0]) if digits else 0, place)


def _residue(gemmi: Any, atom: PqrAtom) -> Any:
    residue = gemmi.Residue()
    residue.name = atom.residue
    residue.seqid = gemmi.SeqId(str(atom.number))
    return residue


def _gemmi_atom(gemmi: Any, atom: PqrAtom) -> Any:
    made = gemmi.Atom()
    made.name = atom.name
    made.element = gemmi.Element(_element(gemmi, atom))
    made.pos = gemmi.Position(*atom.place)
    return made


def _element(gemmi: Any, atom: PqrAtom) -> str:
    """By the atom's name: CA is calcium if the residue is called so too, and else a carbon atom."""
    name = atom.name.lstrip("0123456789").upper()
    ion = _CHARGE_SIGN.sub("", name)
    if ion == _CHARGE_SIGN.sub("", atom.residue.upper()) and gemmi.Element(ion).atomic_number > 0:
        return ion
    return name[:2] if name[:2] in _TWO_LETTERS else name[:1]
