"""Amino acids as rules for placing their atoms one after the other.

Bond lengths and angles: Engh and Huber, Acta Cryst. A47 (1991) 392. Side chains stand in the rotamer that is most
frequent in helices (Dunbrack and Cohen, Protein Sci. 6 (1997) 1661), its torsions rounded to five degrees.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

from volsplat.protocol.geometry.matrices import Vector, cross, minus, normalised

# The ideal right-handed alpha helix: IUPAC-IUB, Biochemistry 9 (1970) 3471.
PHI, PSI, OMEGA = -57.0, -47.0, 180.0


class AtomRule(NamedTuple):
    """An atom by the three before it: bonded to the last, at an angle to the last two, turned about them."""

    name: str  # its first letter is the element
    before: tuple[str, str, str]
    length: float  # Å
    angle: float  # degrees
    torsion: float


def atom_place(rule: AtomRule, places: Mapping[str, Vector]) -> Vector:
    """Where the rule puts its atom, with those before it in their places."""
    first, second, third = (places[name] for name in rule.before)
    along = normalised(minus(third, second))
    normal = normalised(cross(minus(second, first), along))
    side = cross(normal, along)
    angle, torsion = math.radians(rule.angle), math.radians(rule.torsion)
    back, out = -rule.length * math.cos(angle), rule.length * math.sin(angle)
    x, y, z = (
        third[n] + back * along[n] + out * (math.cos(torsion) * side[n] + math.sin(torsion) * normal[n])
        for n in range(3)
    )
    return x, y, z


# From one residue to the next; "-" marks atoms of the one before.
BACKBONE = (
    AtomRule("N", ("-N", "-CA", "-C"), 1.329, 116.2, PSI),
    AtomRule("CA", ("-CA", "-C", "N"), 1.458, 121.7, OMEGA),
    AtomRule("C", ("-C", "N", "CA"), 1.525, 111.2, PHI),
)
OXYGEN = AtomRule("O", ("N", "CA", "C"), 1.231, 120.8, PSI + 180.0)

_CB = AtomRule("CB", ("C", "N", "CA"), 1.530, 110.5, -122.5)
_GAMMA, _DELTA, _EPSILON = ("N", "CA", "CB"), ("CA", "CB", "CG"), ("CB", "CG", "CD")
_CHI1 = -65.0


def _cg(length: float, angle: float) -> tuple[AtomRule, AtomRule]:
    return _CB, AtomRule("CG", _GAMMA, length, angle, _CHI1)


_CHAIN = (*_cg(1.520, 114.1), AtomRule("CD", _DELTA, 1.520, 111.3, 180.0))
_RING = (
    *_cg(1.507, 113.8),
    AtomRule("CD1", _DELTA, 1.384, 120.7, 90.0),
    AtomRule("CD2", _DELTA, 1.384, 120.7, -90.0),
    AtomRule("CE1", ("CB", "CG", "CD1"), 1.382, 120.7, 180.0),
    AtomRule("CE2", ("CB", "CG", "CD2"), 1.382, 120.7, 180.0),
    AtomRule("CZ", ("CG", "CD1", "CE1"), 1.382, 120.0, 0.0),
)

SIDE_CHAINS: dict[str, tuple[AtomRule, ...]] = {
    "G": (),
    "A": (_CB,),
    "V": (_CB, AtomRule("CG1", _GAMMA, 1.521, 110.5, 175.0), AtomRule("CG2", _GAMMA, 1.521, 110.5, -65.0)),
    "L": (
        *_cg(1.530, 116.3),
        AtomRule("CD1", _DELTA, 1.521, 110.7, 175.0),
        AtomRule("CD2", _DELTA, 1.521, 110.7, -65.0),
    ),
    "S": (_CB, AtomRule("OG", _GAMMA, 1.417, 111.1, _CHI1)),
    "T": (_CB, AtomRule("OG1", _GAMMA, 1.433, 109.6, _CHI1), AtomRule("CG2", _GAMMA, 1.521, 110.5, 175.0)),
    "C": (_CB, AtomRule("SG", _GAMMA, 1.808, 114.4, _CHI1)),
    "M": (
        *_cg(1.520, 114.1),
        AtomRule("SD", _DELTA, 1.803, 112.7, 180.0),
        AtomRule("CE", ("CB", "CG", "SD"), 1.791, 100.9, -70.0),
    ),
    "P": (
        _CB,
        AtomRule("CG", _GAMMA, 1.492, 104.5, 30.0),
        AtomRule("CD", _DELTA, 1.503, 106.1, -35.0),
    ),
    "D": (
        *_cg(1.516, 112.6),
        AtomRule("OD1", _DELTA, 1.249, 118.4, -15.0),
        AtomRule("OD2", _DELTA, 1.249, 118.4, 165.0),
    ),
    "N": (
        *_cg(1.516, 112.6),
        AtomRule("OD1", _DELTA, 1.231, 120.8, -20.0),
        AtomRule("ND2", _DELTA, 1.328, 116.4, 160.0),
    ),
    "E": (
        *_cg(1.520, 114.1),
        AtomRule("CD", _DELTA, 1.516, 112.6, 180.0),
        AtomRule("OE1", _EPSILON, 1.249, 118.4, 0.0),
        AtomRule("OE2", _EPSILON, 1.249, 118.4, 180.0),
    ),
    "Q": (
        *_cg(1.520, 114.1),
        AtomRule("CD", _DELTA, 1.516, 112.6, 180.0),
        AtomRule("OE1", _EPSILON, 1.231, 120.8, 0.0),
        AtomRule("NE2", _EPSILON, 1.328, 116.4, 180.0),
    ),
    "K": (
        *_CHAIN,
        AtomRule("CE", _EPSILON, 1.520, 111.3, 180.0),
        AtomRule("NZ", ("CG", "CD", "CE"), 1.489, 111.9, 180.0),
    ),
    "R": (
        *_CHAIN,
        AtomRule("NE", _EPSILON, 1.461, 112.0, 180.0),
        AtomRule("CZ", ("CG", "CD", "NE"), 1.329, 124.2, 180.0),
        AtomRule("NH1", ("CD", "NE", "CZ"), 1.326, 120.0, 0.0),
        AtomRule("NH2", ("CD", "NE", "CZ"), 1.326, 120.0, 180.0),
    ),
    "F": _RING,
    "Y": (*_RING, AtomRule("OH", ("CD1", "CE1", "CZ"), 1.376, 119.9, 180.0)),
    "H": (
        *_cg(1.497, 113.8),
        AtomRule("ND1", _DELTA, 1.378, 122.7, -75.0),
        AtomRule("CD2", _DELTA, 1.354, 131.2, 105.0),
        AtomRule("CE1", ("CB", "CG", "ND1"), 1.321, 109.0, 180.0),
        AtomRule("NE2", ("CB", "CG", "CD2"), 1.374, 107.2, 180.0),
    ),
    "W": (
        *_cg(1.498, 113.6),
        AtomRule("CD1", _DELTA, 1.365, 126.9, 95.0),
        AtomRule("CD2", _DELTA, 1.433, 126.8, -85.0),
        AtomRule("NE1", ("CB", "CG", "CD1"), 1.374, 110.2, 180.0),
        AtomRule("CE2", ("CB", "CG", "CD2"), 1.409, 107.2, 180.0),
        AtomRule("CE3", ("CB", "CG", "CD2"), 1.398, 133.9, 0.0),
        AtomRule("CZ2", ("CG", "CD2", "CE2"), 1.394, 122.4, 180.0),
        AtomRule("CZ3", ("CG", "CD2", "CE3"), 1.382, 118.6, 180.0),
        AtomRule("CH2", ("CD2", "CE2", "CZ2"), 1.368, 117.5, 0.0),
    ),
}
