"""The RNA phantom: the acceptor arm and the T arm of a transfer RNA, one upon the other, as an A-form helix.

Colour plate 3 shows transfer RNA. Its acceptor stem of seven base pairs and its T stem of five are stacked into one
helix (Kim et al., Science 185 (1974) 435), with a nick in one strand. The pairs are those of yeast phenylalanine tRNA
(RajBhandary and Chang, J. Biol. Chem. 243 (1968) 598), modified bases as their parents. The wobble pair G4-U69 stands
as a straight one would.
"""

from functools import cache

import torch

from volsplat.client.phantoms.centred_grid import Phantom, at_once, placed_grid
from volsplat.client.phantoms.molecule import Molecule, density, molecule
from volsplat.client.phantoms.rna_geometry import (
    BACKBONE,
    BASES,
    PHOSPHATE_ATOMS,
    Cylindrical,
    place_in_first_strand,
    place_in_second_strand,
)
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.volume import Index
from volsplat.protocol.geometry.matrices import Vector

RNA_SIZE: Index = (64, 64, 64)
FIELD_OF_VIEW: Vector = (44.0, 44.0, 44.0)  # Å

# From the end of the acceptor arm to the T loop: nucleotides 1-7 and 49-53 with their partners 72-66 and 65-61.
ACCEPTOR_ARM = (("G", "C"), ("C", "G"), ("G", "C"), ("G", "U"), ("A", "U"), ("U", "A"), ("U", "A"))
T_ARM = (("C", "G"), ("U", "A"), ("G", "C"), ("U", "A"), ("G", "C"))
PAIRS = ACCEPTOR_ARM + T_ARM


def rna(size: Index | None = None, spacing: Vector | None = None, seed: int = 0) -> Phantom:
    """float32 synthetic electron density of the twelve base pairs; the helix rises along z."""
    geometry, scale = placed_grid(size or RNA_SIZE, spacing, FIELD_OF_VIEW)
    values = at_once(lambda: density(rna_atoms(), geometry, scale))
    return Phantom(geometry, torch.float32, values, Kind.ATOM_DENSITY, unit="Å")


@cache
def rna_atoms() -> Molecule:
    """All atoms but hydrogen, in Å."""
    atoms = []
    for number, (base, partner) in enumerate(PAIRS):
        level = len(PAIRS) - 1 - number  # the first strand runs downwards from the acceptor's end
        starts_strand = number in (0, len(ACCEPTOR_ARM))
        for atom in _nucleotide(base, starts_strand):
            atoms.append((atom[0], place_in_first_strand(atom, level)))
        for atom in _nucleotide(partner, starts_strand=level == 0):
            atoms.append((atom[0], place_in_second_strand(atom, level)))
    return molecule(atoms)


def _nucleotide(base: str, starts_strand: bool) -> tuple[Cylindrical, ...]:
    return BACKBONE[PHOSPHATE_ATOMS if starts_strand else 0 :] + BASES[base]
