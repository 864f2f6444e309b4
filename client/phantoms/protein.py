"""The protein phantom: the seven helices of a globin, packed as in hemoglobin, its atoms told apart by element.

Colour plate 3 shows hemoglobin, coloured by atom type. Here is the alpha chain of human hemoglobin (UniProt P69905)
without its heme and the turns between its helices: residues A1 to H21 in ideal alpha helices, laid upon those of
the crystal structure 4HHB (Fermi, Perutz, Shaanan and Fourme, J. Mol. Biol. 175 (1984) 159), whose C-alpha atoms they
follow within 0.6 Å (1.1 Å for the short C helix, which is not quite an alpha helix).
"""

import math
from functools import cache
from typing import NamedTuple

import torch

from volsplat.client.phantoms.amino_acids import BACKBONE, OXYGEN, SIDE_CHAINS, AtomRule, atom_place
from volsplat.client.phantoms.centred_grid import Phantom, at_once, placed_grid
from volsplat.client.phantoms.molecule import BANDS, Molecule, elements, molecule
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.volume import Index
from volsplat.protocol.geometry.matrices import Vector, cross, dot, minus, normalised, plus, scaled

PROTEIN_SIZE: Index = (64, 64, 64)
FIELD_OF_VIEW: Vector = (43.0, 43.0, 43.0)  # Å

Residue = dict[str, Vector]  # atoms by name


class Helix(NamedTuple):
    """A helix in the molecule's axes: where its axis begins, where it points, and where the first C-alpha lies."""

    sequence: str
    start: Vector  # Å, the point of the axis beside the first C-alpha
    direction: Vector
    facing: Vector  # from there to that C-alpha


HELICES = (
    Helix("SPADKTNVKAAWGKVG", (0.4, 12.6, 16.8), (0.623, -0.365, -0.692), (-0.782, -0.299, -0.547)),  # A, from 3
    Helix("HAGEYGAEALERMFLS", (12.0, 2.0, -5.3), (-0.597, -0.788, 0.150), (0.717, -0.440, 0.540)),  # B, 20
    Helix("FPTTKTY", (-6.4, -15.5, -1.3), (-0.154, 0.492, -0.857), (0.926, 0.374, 0.049)),  # C, 36
    Helix("SAQVKGHGKKVADALTNAVA", (5.2, -9.7, -16.3), (-0.117, 0.773, 0.624), (0.516, -0.489, 0.703)),  # E, 52
    Helix("LSALSDLHAH", (-6.1, 11.7, -5.6), (-0.633, -0.738, -0.235), (0.370, -0.555, 0.745)),  # F, 80
    Helix("DPVNFKLLSHCLLVTLAAH", (-14.0, -5.8, 0.3), (0.972, 0.001, 0.237), (0.216, 0.404, -0.889)),  # G, 94
    Helix("TPAVHASLDKFLASVSTVLTS", (9.4, 0.0, 18.4), (-0.741, 0.177, -0.647), (0.566, -0.353, -0.745)),  # H, 118
)

# Any residue to begin from; the helix that it starts is moved to its place afterwards.
_SEED: Residue = {"N": (0.0, 0.0, 0.0), "CA": (1.458, 0.0, 0.0), "C": (2.009, 1.422, 0.0)}


def protein(size: Index | None = None, spacing: Vector | None = None, seed: int = 0) -> Phantom:
    """uint8 elements in bands of 32 values (see molecule.CLASSES): bond, C, N, O and S."""
    geometry, scale = placed_grid(size or PROTEIN_SIZE, spacing, FIELD_OF_VIEW)
    values = at_once(lambda: elements(protein_atoms(), geometry, scale))
    return Phantom(geometry, torch.uint8, values, Kind.ELEMENTS, BANDS, "Å")


@cache
def protein_atoms() -> Molecule:
    """All atoms but hydrogen, in Å."""
    atoms = []
    for helix in HELICES:
        for residue in placed(helix, built_helix(helix.sequence)):
            atoms += [(name[0], place) for name, place in residue.items()]
    return molecule(atoms)


def built_helix(sequence: str) -> list[Residue]:
    """An ideal alpha helix somewhere in space, with one residue before the sequence's first."""
    residues: list[Residue] = [_SEED]
    for letter in sequence:
        before = {f"-{name}": residues[-1][name] for name in ("N", "CA", "C")}
        residues.append(_residue(before, (*BACKBONE, OXYGEN, *SIDE_CHAINS[letter])))
    return residues


def _residue(before: Residue, rules: tuple[AtomRule, ...]) -> Residue:
    places = dict(before)
    for rule in rules:
        places[rule.name] = atom_place(rule, places)
    return {name: place for name, place in places.items() if not name.startswith("-")}


def placed(helix: Helix, built: list[Residue]) -> list[Residue]:
    """The residues after the seed, moved so that the helix lies where it belongs."""
    start, direction, facing = _axis(built)
    from_frame = (direction, facing, cross(direction, facing))
    along = normalised(helix.direction)
    out = normalised(minus(helix.facing, scaled(along, dot(helix.facing, along))))
    to_frame = (along, out, cross(along, out))

    def moved(place: Vector) -> Vector:
        offset = minus(place, start)
        result = helix.start
        for old, new in zip(from_frame, to_frame, strict=True):
            result = plus(result, scaled(new, dot(offset, old)))
        return result

    return [{name: moved(place) for name, place in residue.items()} for residue in built[1:]]


def _axis(built: list[Residue]) -> tuple[Vector, Vector, Vector]:
    """Start, direction and facing of a built helix, at the residue after the seed.

    On a helix the second difference of equally spaced points is perpendicular to the axis and points to it.
    """
    points = [residue["CA"] for residue in built[:4]]
    bend, next_bend = (plus(minus(points[n - 1], scaled(points[n], 2)), points[n + 1]) for n in (1, 2))
    inwards, next_inwards = normalised(bend), normalised(next_bend)
    radius = math.sqrt(dot(bend, bend)) / (2 * (1 - dot(inwards, next_inwards)))
    direction = normalised(cross(inwards, next_inwards))
    return plus(points[1], scaled(inwards, radius)), direction, scaled(inwards, -1)
