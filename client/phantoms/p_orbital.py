"""The bonding orbital of copper chloride, after colour plate 3: "the p-orbitals of copper chloride".

The sigma bond of the molecule CuCl by the extended Hueckel method (Hoffmann 1963): Slater orbitals, the Hamiltonian of
Wolfsberg and Helmholz. Chlorine's 3p along the bond mixes with copper's 4s and 3d(z2); of the three molecular orbitals
the lowest is bonding, and its density between the atoms is what they share.

Sources. Bond length: Huber and Herzberg, Constants of Diatomic Molecules (1979). Exponents and energies, Cu: Hay,
Thibeault and Hoffmann, J. Am. Chem. Soc. 97 (1975) 4884; Cl: Summerville and Hoffmann, ibid. 98 (1976) 7240.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import torch
from torch import Tensor

from volsplat.client.phantoms.centred_grid import Phantom, placed_grid, sheet_positions
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.geometry.matrices import Vector

P_ORBITAL_SIZE: Index = (64, 64, 64)
FIELD_OF_VIEW: Vector = (4.2, 4.2, 6.0)  # Å; holds all but a few thousandths of the electron
BOHR = 0.529177  # Å
BOND_LENGTH = 2.0512  # Å
HELMHOLZ_FACTOR = 1.75

# The atoms on the z axis, Å: their midpoint is the middle of the grid.
CHLORINE, COPPER = -BOND_LENGTH / 2, BOND_LENGTH / 2


@dataclass(frozen=True)
class SlaterOrbital:
    """r^(n-1) times exponentials, times a real harmonic of m = 0; lengths in bohr."""

    atom: float  # z
    n: int
    l: int  # noqa: E741  its name everywhere
    terms: tuple[tuple[float, float], ...]  # coefficient, exponent
    energy: float  # eV: minus the ionisation potential of the valence state

    def value(self, rho2: Tensor, z: Tensor) -> Tensor:
        """The wave function at a squared distance from the axis and a height."""
        dz = z - self.atom
        r = torch.sqrt(rho2 + dz * dz)
        radial = sum((c * _norm(self.n, zeta) * torch.exp(-zeta * r) for c, zeta in self.terms), torch.zeros(()))
        return radial * r ** (self.n - 1) * _harmonic(self.l, dz / r.clamp(min=1e-12))


def _norm(n: int, zeta: float) -> float:
    return math.sqrt((2 * zeta) ** (2 * n + 1) / math.factorial(2 * n))


def _harmonic(degree: int, cosine: Tensor) -> Tensor:
    """Of m = 0, real and normalised."""
    shape = (torch.ones_like(cosine), cosine, (3 * cosine * cosine - 1) / 2)[degree]
    return shape * math.sqrt((2 * degree + 1) / (4 * math.pi))


CHLORINE_3P = SlaterOrbital(CHLORINE / BOHR, 3, 1, ((1.0, 1.733),), -14.2)
COPPER_4S = SlaterOrbital(COPPER / BOHR, 4, 0, ((1.0, 2.2),), -11.4)
COPPER_3D = SlaterOrbital(COPPER / BOHR, 3, 2, ((0.5933, 5.95), (0.5744, 2.3)), -14.0)
BASIS = (CHLORINE_3P, COPPER_4S, COPPER_3D)

QUADRATURE_STEP, QUADRATURE_REACH = 0.05, 16.0  # bohr


@cache
def overlaps() -> Tensor:
    """The basis functions' products integrated over space, float64 (3, 3), by the midpoint rule about the axis."""
    steps = torch.arange(0.5, QUADRATURE_REACH / QUADRATURE_STEP, dtype=torch.float64) * QUADRATURE_STEP
    rho, z = steps[:, None], torch.cat((-steps.flip(0), steps))[None, :]
    rings = (2 * math.pi * QUADRATURE_STEP**2 * rho).expand(-1, z.shape[1])
    values = torch.stack([orbital.value(rho * rho, z) for orbital in BASIS])
    return torch.einsum("arz,brz,rz->ab", values, values, rings)


@cache
def bonding_coefficients() -> tuple[float, ...]:
    """Of the basis functions in the lowest molecular orbital, which is normalised; chlorine's is positive."""
    overlap = overlaps()
    energies = torch.tensor([orbital.energy for orbital in BASIS], dtype=torch.float64)
    hamiltonian = HELMHOLZ_FACTOR * overlap * (energies[:, None] + energies[None, :]) / 2
    hamiltonian.diagonal().copy_(energies * overlap.diagonal())
    inverse = torch.linalg.inv(torch.linalg.cholesky(overlap))
    _, vectors = torch.linalg.eigh(inverse @ hamiltonian @ inverse.T)
    lowest = inverse.T @ vectors[:, 0]
    return tuple((lowest * torch.sign(lowest[0])).tolist())


def p_orbital(size: Index | None = None, spacing: Vector | None = None, seed: int = 0) -> Phantom:
    """float32 probability of finding an electron of the bond, per cubic Å; chlorine at -z, copper at +z.

    Without a spacing the grid fills the field of view, with finer steps across the bond than along it.
    """
    size = size or P_ORBITAL_SIZE
    i, j, k = (length / count for length, count in zip(FIELD_OF_VIEW, size, strict=True))
    geometry, scale = placed_grid(size, spacing or (i, j, k), FIELD_OF_VIEW)
    return Phantom(geometry, torch.float32, _probability(geometry, 1 / (scale * BOHR)), Kind.ELECTRON_DENSITY, unit="Å")


def _probability(geometry: Geometry, unit: float) -> Iterator[Tensor]:
    for x, y, z in sheet_positions(geometry):
        rho2, height = (x * x + y * y) * unit**2, z * unit
        wave = sum(
            (c * orbital.value(rho2, height) for c, orbital in zip(bonding_coefficients(), BASIS, strict=True)),
            torch.zeros(()),
        )
        yield wave * wave / BOHR**3
