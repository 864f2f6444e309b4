"""The head phantom: a CT of nobody, 96 x 128 x 113 voxels like the paper's study."""

from collections.abc import Iterator

import torch
from torch import Tensor

from volsplat.client.phantoms import head_anatomy as anatomy
from volsplat.client.phantoms.centred_grid import Phantom, SheetNoise, placed_grid, sheet_positions
from volsplat.client.phantoms.solids import blended_minimum, coverage, union, without
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.geometry.matrices import Vector

HEAD_SIZE: Index = (96, 128, 113)

# CT values as scanners store them: Hounsfield units + 1024. The brain has more contrast than in a real CT, where
# a person would not find the ventricles among the noise of a single slice.
AIR, FAT, LIQUID, WHITE_MATTER, GREY_MATTER, SKIN, MUSCLE = 24.0, 940.0, 1020.0, 1048.0, 1074.0, 1050.0, 1080.0
SPONGY_BONE, BONE, TOOTH, METAL = 1550.0, 2150.0, 2500.0, 3000.0
NOISE = 5.0
LARGEST_VALUE = 4095

SKIN_DEPTH = 3.0  # mm
FAT_DEPTH = 6.0
FLESH_OVER_BONE = 6.0  # at least, or the bone would shine through the skin
CORTEX_DEPTH = 4.0
BONE_WALL = 2.2  # of the compact layers round spongy bone
EDGE_VOXELS = 2.2  # width of a smooth edge: sharper ones show rings where the surface meets the grid


def head(size: Index | None = None, spacing: Vector | None = None, seed: int = 0) -> Phantom:
    """uint16 CT values (HU + 1024) of a head that fills the grid: the face to -y, its left to +x, the top to +z.

    Without a spacing, voxels are cubes and the head is life-size; with one, the head is scaled to the grid.
    """
    size = size or HEAD_SIZE
    geometry, scale = placed_grid(size, spacing, anatomy.FIELD_OF_VIEW)
    return Phantom(
        geometry, torch.uint16, _scanned(geometry, scale, SheetNoise(seed, NOISE)), Kind.CT, unit="mm", anatomical=True
    )


def _scanned(geometry: Geometry, scale: float, noise: SheetNoise) -> Iterator[Tensor]:
    edge = EDGE_VOXELS * geometry.reference_spacing / scale
    for x, y, z in sheet_positions(geometry):
        sheets = _ct_values(x / scale, y / scale, z / scale, edge)
        sheets += noise.next(*sheets.shape)
        yield sheets.round_().clamp_(0, LARGEST_VALUE).to(torch.uint16)


def _ct_values(x: Tensor, y: Tensor, z: Tensor, edge: float) -> Tensor:
    """Noise-free CT values at positions in mm; surfaces fade over `edge` mm. Later tissues lie over earlier ones."""
    skin = _skin(x, y, z)
    values = torch.full_like(skin, AIR)
    _lay(values, skin, SKIN, edge)
    _lay(values, skin + SKIN_DEPTH, FAT, edge)
    _lay(values, skin + SKIN_DEPTH + FAT_DEPTH, MUSCLE, edge)

    orbits = union(anatomy.ORBITS, x, y, z)
    _lay(values, torch.maximum(orbits, skin + SKIN_DEPTH), FAT, edge)
    _lay(values, union(anatomy.EYES, x, y, z), LIQUID + 10, edge)

    inside = torch.maximum(union(anatomy.SKULL_INSIDE, x, y, z), anatomy.SKULL_BASE - z)
    bone = _bone(x, y, z, inside, orbits, skin)
    _lay(values, bone, BONE, edge)
    _lay(values, bone + BONE_WALL, SPONGY_BONE, edge)
    _lay_brain(values, x, y, z, inside, edge)

    air = torch.maximum(union(anatomy.AIR_SPACES, x, y, z), -inside)
    _lay(values, torch.maximum(air, skin + FLESH_OVER_BONE + BONE_WALL), AIR, edge)
    _lay(values, union(anatomy.EAR_CANALS, x, y, z), AIR, edge)
    _lay(values, union(anatomy.TEETH, x, y, z), TOOTH, edge)
    _lay(values, union(anatomy.EAR_BEAD, x, y, z), METAL, edge)
    return values


def _lay(values: Tensor, distance: Tensor, value: Tensor | float, edge: float) -> None:
    """Puts a tissue over what is there, mixed by how much of the place it covers."""
    values += coverage(distance, edge) * (value - values)


def _skin(x: Tensor, y: Tensor, z: Tensor) -> Tensor:
    """The distance from the head's surface, mouth and nostrils open."""
    skin = union(anatomy.SKIN, x, y, z, anatomy.SKIN_BLEND)
    skin = without(skin, union(anatomy.EYE_HOLLOWS, x, y, z), 8.0)
    skin = blended_minimum(skin, union(anatomy.FEATURES, x, y, z, 3.0), anatomy.FEATURES_BLEND)
    skin = blended_minimum(skin, union(anatomy.EYELIDS, x, y, z), 2.0)
    ears = without(union(anatomy.EARS, x, y, z, 4.0), union(anatomy.EAR_HOLLOWS, x, y, z), 3.0)
    skin = blended_minimum(skin, ears, 4.0)
    skin = without(skin, union(anatomy.MOUTH, x, y, z), 2.0)
    return without(skin, union(anatomy.NOSTRILS, x, y, z), 1.0)


def _bone(x: Tensor, y: Tensor, z: Tensor, inside: Tensor, orbits: Tensor, skin: Tensor) -> Tensor:
    """The distance from all bone but the teeth."""
    base = anatomy.SKULL_BASE - anatomy.SKULL_BASE_THICKNESS - z
    skull = torch.maximum(union(anatomy.SKULL_OUTSIDE, x, y, z), base)
    blend = anatomy.FACE_BONES_BLEND
    bone = blended_minimum(skull, union(anatomy.FACE_BONES, x, y, z, blend), blend)
    bone = without(bone, inside)
    bone = without(bone, union(anatomy.FORAMEN_MAGNUM, x, y, z))
    bone = without(bone, orbits, 2.0)
    bone = without(bone, union(anatomy.PEAR_OPENING, x, y, z), 2.0)
    spine = without(union(anatomy.VERTEBRAE, x, y, z), union(anatomy.SPINAL_CORD, x, y, z))
    bone = torch.minimum(torch.minimum(bone, spine), union(anatomy.MANDIBLE, x, y, z, 4.0))
    return torch.maximum(bone, skin + FLESH_OVER_BONE)


def _lay_brain(values: Tensor, x: Tensor, y: Tensor, z: Tensor, inside: Tensor, edge: float) -> None:
    """Liquid in the whole skull, the hemispheres with their folds in it, and the ventricles in those."""
    _lay(values, torch.minimum(inside, union(anatomy.SPINAL_CORD, x, y, z)), LIQUID, edge)
    folds = torch.sin(x * 0.42 + 1.8 * torch.sin(z * 0.13)) + torch.sin(y * 0.36 + 1.6 * torch.sin(x * 0.17))
    folds = 1.5 * (folds + torch.sin(z * 0.38 + 1.7 * torch.sin(y * 0.15)))
    half_width, floor = anatomy.FISSURE
    fissure = torch.maximum(x.abs() - half_width, floor - z)
    brain = without(torch.maximum(union(anatomy.BRAIN, x, y, z) + folds, inside + 1.5), fissure)
    stem = union(anatomy.BRAIN_STEM, x, y, z)
    cerebellum = union(anatomy.CEREBELLUM, x, y, z, 3.0) + torch.sin(z * 1.1)
    hind = torch.maximum(torch.minimum(cerebellum, stem), inside + 1.5)
    _lay(values, torch.minimum(brain, hind), GREY_MATTER, edge)
    _lay(values, torch.minimum(brain + CORTEX_DEPTH + folds, stem + CORTEX_DEPTH), WHITE_MATTER, edge)
    _lay(values, union(anatomy.VENTRICLES, x, y, z, 2.0), LIQUID, edge)
