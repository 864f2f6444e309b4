"""A-form RNA from fibre diffraction: cylindrical coordinates of a nucleotide's atoms.

Arnott, Hukins, Dover, Fuller and Hodgson, J. Mol. Biol. 81 (1973) 107: a helix of 11 nucleotides a turn that rises by
2.81 Å for each. Radii and heights are in Å, angles in degrees; the z axis is the helix's, the x axis its dyad.
"""

import math

from volsplat.protocol.geometry.matrices import Vector

RISE = 2.81  # Å for each nucleotide
TWIST = 360 / 11  # degrees

Cylindrical = tuple[str, float, float, float]  # element, radius, angle, height

BACKBONE: tuple[Cylindrical, ...] = (
    ("O", 9.54, 72.8, -2.44),  # O3' of the nucleotide before
    ("P", 8.71, 70.5, -3.75),
    ("O", 9.59, 71.2, -4.94),
    ("O", 7.50, 76.6, -3.80),
    ("O", 8.49, 60.1, -3.48),  # O5'
    ("C", 9.75, 55.8, -3.35),  # C5'
    ("C", 9.68, 46.6, -3.10),  # C4'
    ("O", 9.15, 45.3, -1.77),  # O4'
    ("C", 8.86, 41.4, -4.02),  # C3'
    ("C", 8.82, 33.2, -3.17),  # C2'
    ("O", 10.15, 30.2, -3.14),  # O2'
    ("C", 8.55, 36.9, -1.77),  # C1'
)
PHOSPHATE_ATOMS = 4  # at the head of BACKBONE; the first nucleotide of a strand has none

BASES: dict[str, tuple[Cylindrical, ...]] = {
    "A": (
        ("N", 7.12, 37.2, -1.39),
        ("C", 6.39, 47.0, -1.33),
        ("N", 5.15, 46.2, -0.95),
        ("C", 5.14, 30.9, -0.75),
        ("C", 4.39, 17.4, -0.34),
        ("N", 3.08, 15.6, -0.05),
        ("N", 5.28, 5.5, -0.24),
        ("C", 6.54, 8.7, -0.54),
        ("N", 7.15, 18.0, -0.93),
        ("C", 6.44, 27.6, -1.01),
    ),
    "G": (
        ("N", 7.12, 37.2, -1.39),
        ("C", 6.36, 47.0, -1.32),
        ("N", 5.11, 46.0, -0.94),
        ("C", 5.13, 30.5, -0.74),
        ("C", 4.34, 17.1, -0.33),
        ("O", 3.16, 13.9, -0.04),
        ("N", 5.35, 5.5, -0.26),
        ("C", 6.67, 8.5, -0.55),
        ("N", 7.58, 0.7, -0.42),
        ("N", 7.20, 18.0, -0.94),
        ("C", 6.44, 27.5, -1.01),
    ),
    "C": (
        ("N", 7.12, 37.2, -1.39),
        ("C", 6.53, 47.6, -1.38),
        ("C", 5.26, 50.6, -1.03),
        ("C", 4.50, 36.8, -0.67),
        ("N", 3.23, 36.1, -0.31),
        ("N", 5.32, 24.4, -0.68),
        ("C", 6.61, 26.8, -1.04),
        ("O", 7.51, 19.9, -1.06),
    ),
    "U": (
        ("N", 7.12, 37.2, -1.39),
        ("C", 6.54, 47.7, -1.38),
        ("C", 5.28, 50.8, -1.04),
        ("C", 4.42, 37.8, -0.66),
        ("O", 3.24, 37.1, -0.32),
        ("N", 5.31, 25.2, -0.69),
        ("C", 6.63, 26.9, -1.04),
        ("O", 7.46, 19.6, -1.04),
    ),
}


def place_in_first_strand(atom: Cylindrical, level: float) -> Vector:
    """The atom of the nucleotide `level` steps up; this strand runs downwards."""
    _, radius, angle, height = atom
    turned = math.radians(angle + TWIST * level)
    return radius * math.cos(turned), radius * math.sin(turned), height + RISE * level


def place_in_second_strand(atom: Cylindrical, level: float) -> Vector:
    """The atom of the nucleotide that is paired with the first strand's at `level`: turned over about the dyad."""
    _, radius, angle, height = atom
    turned = math.radians(-angle + TWIST * level)
    return radius * math.cos(turned), radius * math.sin(turned), -height + RISE * level
