"""Image-aligned slabs of a frame of step G: planes parallel to the screen, and the kernel that they cut.

After Mueller and Crawfis 1998 (image-aligned sheet buffers) and Mueller, Möller and Crawfis 1999 (splatting without the
blur). A radial kernel K in index space, carried to the screen by the matrix D, is K(rho), rho^2 = v^T (D D^T)^-1 v. On
each plane the frame adds up the weighted densities of the voxels around, and their weights; their quotient is the
density there. A slab lies between two neighbouring planes, and is classified and lit for each pixel.

Depth here is measured in planes, from the first to the last away from the viewer.
"""

import itertools
import math

import msgspec

from volsplat.protocol.description.scene import Reconstruction, SlabKernel
from volsplat.protocol.description.volume import LONGEST_AXIS, Box, Geometry, Index
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix, Vector
from volsplat.protocol.rules.footprint_shape import CORRECT_SPACING, GREATEST_COEFFICIENT, widened
from volsplat.protocol.rules.grid_on_screen import Dda, GridOnScreen, dda
from volsplat.protocol.rules.levels import point_at_level
from volsplat.protocol.rules.packet_layout import DEPTH_BITS, GROUP_PLANES, SUBPIXEL_BITS
from volsplat.protocol.rules.slab_kernels import GREATEST_OVERSHOOT, INNER_RADIUS, OVERSHOOT, SLAB_RADIUS
from volsplat.protocol.rules.slab_needs import Neighbourhood, Radii, surroundings

MOST_PLANES = 1 << 20
LARGEST_REACH = 16384  # pixels, and planes: a voxel's kernel is no larger to either side
GREATEST_BASELINE = 256  # pixels
GREATEST_NUMBER = 1e30  # that is computed with, squared at most
OFFSETS_IN_A_VOXEL = 16
FINEST_OFFSET_BITS = 4


class SlabShape(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Weights are amplitude * K(rho) / integral of K over space, rho^2 = (x, y, d) form (x, y, d)^T, zero beyond
    `radius`; x and y in pixels, d in planes."""

    planes: int
    thickness: float  # of a slab, in the volume's reference spacings
    depth: Dda  # of a grid point, in planes
    kernel: SlabKernel
    radius: float  # in voxels, the units of rho
    offset_bits: int  # the table of slices has 2^offset_bits offsets a pixel
    amplitude: float
    form: Matrix
    half_extents: Vector  # of the ellipsoid's bounding box: pixels, pixels, planes
    baseline: int  # pixels: gradients are differences over so many to either side
    looks: Neighbourhood  # of the voxel in whose cell a slab has its middle: what its densities can depend on
    inner: Neighbourhood  # of these, all that may have weights above 0
    needs: Neighbourhood  # and what its gradient can depend on as well
    overshoot: float  # by which densities may leave those of the inner voxels, as a share of how far the others go
    beyond: Index  # how many voxels outside of the bounds may be needed for what is drawn within
    grid: tuple[Vector, Vector, Vector, Vector]  # i, j, k of pixel (0, 0) on plane 0, and what each of x, y, d adds
    gradient: Matrix  # from differences per pixel right, pixel down and plane to those per unit along physical axes
    low: Vector  # grid coordinates within which slabs are drawn
    high: Vector

    def __post_init__(self) -> None:
        if not 2 <= self.planes <= MOST_PLANES:
            raise ValueError(f"a frame of slabs needs 2 to {MOST_PLANES} planes, not {self.planes}")
        numbers = [self.thickness, self.amplitude, *self.low, *self.high]
        numbers += [number for row in (*self.grid, *self.gradient) for number in row]
        if not all(abs(number) <= GREATEST_NUMBER for number in numbers):
            raise ValueError(f"the numbers of a frame of slabs must be {GREATEST_NUMBER:g} at most; {CORRECT_SPACING}")
        if not (self.thickness > 0 and self.amplitude >= 0):
            raise ValueError("slabs need a thickness above 0, and an amplitude not below it")
        if not all(abs(number) <= GREATEST_COEFFICIENT for row in self.form for number in row):
            raise ValueError(
                f"the coefficients of a kernel's ellipsoid must be {GREATEST_COEFFICIENT:g} at most; {CORRECT_SPACING}"
            )
        if not all(0 < extent <= LARGEST_REACH for extent in self.half_extents):
            reach = " x ".join(f"{extent:.5g}" for extent in self.half_extents)
            raise ValueError(
                f"a kernel must reach 0 to {LARGEST_REACH} pixels and planes, not {reach}; lower the zoom, or "
                f"{CORRECT_SPACING}"
            )
        if not 1 <= self.baseline <= GREATEST_BASELINE:
            raise ValueError(f"gradients look 1 to {GREATEST_BASELINE} pixels aside, not {self.baseline}")
        if not all(0 <= voxels <= LONGEST_AXIS for voxels in self.beyond):
            raise ValueError(f"a kernel reaches 0 to {LONGEST_AXIS} voxels")
        if not 0 <= self.offset_bits <= FINEST_OFFSET_BITS:
            raise ValueError(f"a table of slices has 2^0 to 2^{FINEST_OFFSET_BITS} offsets a pixel")
        if not 0 <= self.overshoot <= GREATEST_OVERSHOOT:
            raise ValueError(f"densities overshoot by 0 to {GREATEST_OVERSHOOT:g}, not {self.overshoot}")
        Reconstruction(radius=self.radius)

    @property
    def before(self) -> int:
        """How many planes before that below a voxel's depth its kernel may reach, and as many behind the one above."""
        return math.ceil(self.half_extents[2])

    @property
    def lead(self) -> int:
        """How many planes before plane 0 the groups begin: with the first that a voxel before it may reach."""
        return 2 * self.before + 1

    @property
    def groups(self) -> int:
        """In how many groups of planes voxels are sent (see packet_layout)."""
        return (self.planes - 1 + self.lead) // GROUP_PLANES + 1


def slab_shape(
    grid: GridOnScreen, geometry: Geometry, rotation: Matrix, reconstruction: Reconstruction, clip: Box
) -> SlabShape:
    """Of a view of a level of `geometry` as `grid`, of which the voxels of `clip` are drawn.

    `rotation` is that from physical to screen axes. Raises ValueError where the planes are too many.
    """
    spacing = reconstruction.slab * grid.zoom  # of planes, in pixels
    radius, offset_bits = SLAB_RADIUS[reconstruction.slab_kernel], _offset_bits(grid.zoom)
    radii = Radii(radius, INNER_RADIUS[reconstruction.slab_kernel])
    covariance, baseline = _covariance(grid, spacing), max(1, round(grid.zoom / 2))
    to_grid = matrices.inverse(grid.pixels_per_index)
    across, down = matrices.column(to_grid, 0), matrices.column(to_grid, 1)
    behind = matrices.scaled(matrices.column(to_grid, 2), -spacing)  # from a plane to the next
    around = surroundings(grid, geometry, radii, spacing, baseline, _rounding(spacing, offset_bits))
    half_x, half_y, half_z = (radius * math.sqrt(covariance[axis][axis]) for axis in range(3))
    low, high = _around(clip)
    # The middle of the volume lies on a plane, whatever is drawn of it
    depths = matrices.scaled(grid.pixels_per_index[2], -1 / spacing)
    middle = matrices.dot(depths, point_at_level(_middle(geometry.dims), grid.factors))
    corners = [matrices.dot(depths, (i, j, k)) - middle for i, j, k in itertools.product(*zip(low, high, strict=True))]
    first = math.floor(min(corners))
    front = (0.0, 0.0, grid.origin[2] - (middle + first) * spacing)  # pixel (0, 0) on plane 0
    per_pixel = grid.zoom / (geometry.reference_spacing * grid.thickness)  # along physical axes
    return SlabShape(
        planes=math.ceil(max(corners)) + 1 - first,
        thickness=reconstruction.slab * grid.thickness,
        depth=dda(-(middle + first), depths),
        kernel=reconstruction.slab_kernel,
        radius=radius,
        offset_bits=offset_bits,
        amplitude=_gain(grid, covariance),
        form=matrices.inverse(_in_planes(covariance, spacing)),
        half_extents=(half_x, half_y, half_z / spacing),
        baseline=baseline,
        looks=around.looks,
        inner=around.inner,
        needs=around.needs,
        overshoot=OVERSHOOT[reconstruction.slab_kernel],
        beyond=around.beyond,
        grid=(matrices.applied(to_grid, matrices.minus(front, grid.origin)), across, down, behind),
        gradient=_gradient(rotation, per_pixel, spacing),
        low=low,
        high=high,
    )


def _offset_bits(zoom: float) -> int:
    """The binary logarithm of the offsets a pixel in the table of slices: some sixteen a voxel."""
    return min(max(math.ceil(math.log2(OFFSETS_IN_A_VOXEL / zoom)), 0), FINEST_OFFSET_BITS)


def _rounding(spacing: float, offset_bits: int) -> float:
    """How far, in pixels, the wire's lattice and the table's offsets may move a voxel."""
    aside = 2.0 ** -(offset_bits + 1) + 2.0 ** -(SUBPIXEL_BITS + 1)
    return math.hypot(aside, aside, spacing / (2 << DEPTH_BITS))


def _covariance(grid: GridOnScreen, spacing: float) -> Matrix:
    """What carries the unit ball of index space to the screen, in pixels, as a symmetric matrix.

    It is widened to a pixel across and, where planes are further apart than voxels, to their spacing in depth, so that
    nothing aliases.
    """
    to_screen = grid.pixels_per_index
    v = matrices.product(to_screen, matrices.transposed(to_screen))
    xx, xy, yy = widened(v[0][0], v[0][1], v[1][1])
    return ((xx, xy, v[0][2]), (xy, yy, v[1][2]), (v[0][2], v[1][2], max(v[2][2], spacing * spacing)))


def _gain(grid: GridOnScreen, covariance: Matrix) -> float:
    """What keeps the sum of all weights at a point 1."""
    volume = abs(matrices.determinant(grid.pixels_per_index))
    return volume / math.sqrt(matrices.determinant(covariance))


def _in_planes(covariance: Matrix, spacing: float) -> Matrix:
    """With depth in planes, away from the viewer, in the place of pixels towards him."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = covariance
    xd, yd, dd = -xz / spacing, -yz / spacing, zz / (spacing * spacing)
    return ((xx, xy, xd), (xy, yy, yd), (xd, yd, dd))


def _gradient(rotation: Matrix, per_pixel: float, spacing: float) -> Matrix:
    """`per_pixel`: how many pixels a unit of physical length has."""
    x, y, z = matrices.transposed(rotation)
    rows = [(row[0] * per_pixel, -row[1] * per_pixel, -row[2] * per_pixel / spacing) for row in (x, y, z)]
    return (rows[0], rows[1], rows[2])


def _middle(dims: Index) -> Vector:
    return ((dims[0] - 1) / 2, (dims[1] - 1) / 2, (dims[2] - 1) / 2)


def _around(box: Box) -> tuple[Vector, Vector]:
    """The corners of all its voxels' cells."""
    (i0, j0, k0), (i1, j1, k1) = box
    return (i0 - 0.5, j0 - 0.5, k0 - 0.5), (i1 - 0.5, j1 - 0.5, k1 - 0.5)
