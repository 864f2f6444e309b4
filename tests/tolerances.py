"""Every tolerance of the tests, with its reason. Tests never type a number of their own."""

ONE_LEVEL = 1 / 255
"""One level of an 8-bit display: what nobody can see (design, section 4)."""

ROTATION_ENTRY = 1e-14
"""Entries of a rotation made from a quaternion in float64: a few dozen roundings of numbers up to 1."""

ROUNDING = 1e-9
"""Of numbers near 1 after some dozens of float64 operations."""

HALF_A_LATTICE_STEP = 1 / 128
"""Positions are rounded to 1/64 pixel (design, section 3.6)."""

MIDDLE_OF_FOOTPRINT = 0.06
"""Pixels: where the middle of a footprint is seen, whose offsets are rounded to 1/16 pixel at the coarsest."""

A_LATTICE_STEP = 1 / 64
"""Each sheet of footprints rounds them by a threshold of its own, and down where a voxel is one pixel (rounding.py)."""

DDA_DRIFT = 1e-6
"""Pixels: half steps are rounded to 2^-32, and some thousands of them add up."""

HALF_A_LEVEL = {"uint8": 0.5 / 255 + 1e-6, "float": 0.0}
"""What rounding to a file's pixels may change; float32 itself holds 0..1 to 6e-8."""

JPEG_LEVELS = 6 / 255
"""JPEG of quality 95 on smooth ramps: quantised coefficients, and YCbCr rounded to 8 bits."""

QUADRATURE = 1e-6
"""Of integrals by 96 points over profiles whose second derivative may jump."""

FIT = 1e-12
"""Relative: of a fit, whose sums are in another order."""

PROFILE = 1e-6
"""Of P(rho), interpolated between 8193 angles."""

SUM_OVER_PIXELS = 1e-3
"""Of a sum over 513 x 513 points for an integral whose integrand has a kink at its rim."""

CODE_TIE = 1 / 256
"""Of the smallest opacity step: opacities are first rounded to 1/256 of it, so near ties may fall either way."""

MISMATCHED_OBLIQUE = 0.001
"""The share of pixels that quantised positions may move by more than one level (design, section 4)."""

MISMATCHED_AXIS_ALIGNED = 0.005
"""Likewise in axis-aligned views, where all samples round the same way (design, section 4)."""

SQUARE_ROOT = 1e-15
"""Relative: torch's square root of float64 is not always correctly rounded, ours is."""

FLOAT32_COLOUR = 2e-4
"""Levels: a colour sum of up to 3 is made in float32, a handful of roundings of 255 * 3 * 6e-8."""

POWER = 1e-12
"""Relative: an exponent of 1000 magnifies the rounding of the logarithm, in ours and in libm's alike."""

OPACITY_CODE = 1 / 1024
"""Of a slab's alpha: relative steps of 1/512 at most in each sheet's opacity, all rounded the same way."""

STRIDES = 2 / 255
"""A, B and C on a homogeneous slab (design, section 4)."""

BLOCKY_SIDES = 0.001
"""An opacity, not a tolerance: at this one a sheet of stride 4 is below one level, so that where a ray crosses the
slanted sides of a slab one sheet more or less stays within STRIDES."""

FOG = 0.015
"""Relative, of optical depth: 1 % of ripple and half a step of the opacity code, 1/512."""

CODED_DIRECTION = 0.02
"""Of a colour up to 0.5 lit under a power of 8: a direction code is off by up to 1.3 degrees, 0.023 radians."""

ROUNDED_COLOUR = 0.5 / 255 + 1e-6
"""Half a level of an 8-bit colour, and float32."""

GEOMETRY_FLOAT64 = 1e-12
"""Relative: NRRD and MetaImage write 17 digits, and spacing times direction is rounded twice."""

GEOMETRY_FLOAT32 = 2e-6
"""Relative: NIfTI keeps its affine in float32, and a quaternion of it."""

SIX_DIGITS = 1e-5
"""Relative: VTK writes numbers as text with six digits in its older files."""

GEOMETRY_PRINTED = 5e-4
"""Of spacings as the data's own table prints them."""

RANGE_PRINTED = 5e-3
"""Relative, of value ranges as the data's own table prints them."""

SIGNAL_FLOAT32 = 2e-5
"""The Marschner-Lobb signal in float32: its phase of 12 pi magnifies the rounding of the cosine inside."""

SHELLS_VISIBLE = (0.10, 0.15)
"""The share of the shells' voxels that their own tables show."""

SPLAT_FLOAT32 = 1e-5
"""The image buffer is float32: some hundreds of roundings of numbers up to 1."""

PROJECTION = 2e-5
"""Of P(rho) up to 1: interpolations over 1024 and 8192 intervals, and float32."""

CONE_TIP = 5e-4
"""As PROJECTION for the cone, whose P goes as rho^2 log rho at its middle, where interpolation is at its worst."""

UNITY_ROUNDED_POSITIONS = 0.02
"""Relative, of one sheet: positions are rounded to 1/64 pixel, in axis-aligned views all alike; see
protocol/rules/footprint_shape.py. It holds 1e-4 of float32 sums and of thin opacities that weaken each other, too."""

HANDEDNESS = 1 / 255
"""The same samples at the same places, up to a step of the position lattice and the rounding of directions."""

SAME_NUMBERS = 1e-4
"""Between the splat kernel's float32 and the reference's float64 over some hundreds of samples a pixel."""

BETWEEN_CPU_PATHS = 1e-5
"""What the splat kernel may differ by between instruction sets (design, section 3.5)."""

ONE_BYTE = 1
"""A histogram's peak lies in one of two neighbouring bytes if the true value falls between them."""

EDGE_ANGLE = 1e-9
"""Relative: a face whose normal turns less than this to or from the viewer is seen edge on."""

SAME_SILHOUETTE = 1.0 + 1 / 3.7
"""Voxels: one, and the pixel that each of two masks is rounded to, at 3.7 pixels a voxel."""

MIRRORED_SILHOUETTE = 4 * SAME_SILHOUETTE
"""Voxels: how far a mirrored head's silhouette must stick out for the comparison to be worth anything."""

SURFACE_VOXELS = 4
"""Voxels: depth is told in bytes of 0.8 voxel, the skin's tables rise over about two, and footprints reach two."""

SUM_OF_WEIGHTED_ADDS = 1e-5
"""Thirty float32 adds of values up to 1, fused or not, to a pixel."""

ALIKE_SMOOTH = 0.97
"""SSIM of a smooth ball by a splatter and by a ray caster: the footprint blurs by 0.7 voxel what rays do not."""

UNLIKE_MIRRORED = 0.93
"""SSIM of an asymmetric body and its mirror image stays below."""

VIDEO_LEVELS = 4 / 255
"""A flat colour, or the mean over a frame, after 8-bit YCbCr of limited range and a codec of high quality."""

POINT_TIE = 1e-6
"""Pixels and cells: nearer than this to an edge, rounding decides whether a voxel lies under a point."""

CAMERA_PIXELS = 1e-3
"""What the page draws over a picture, in pixels: far below what is seen, far above float64 at zooms up to 256."""

HALF_A_CSS_PIXEL = 0.5
"""A mark's place as the browser reports it, its box rounded outwards to whole pixels."""

ONE_PIXEL_OF_A_TABLE = 0.02
"""Positions and values set by the mouse: a table is drawn at least 60 pixels high, and the mouse goes by whole ones."""

FREEHAND_PIXELS = 0.035
"""Entries of a curve drawn by the mouse: a pixel of its height, half an entry of its steepest stroke, the thinning."""

FLOAT32_SCALED = 3e-7
"""Relative, of float32 made from scaled integers: we round once, astropy after each operation."""

SKY_CURVATURE = 2e-3
"""Relative, of a step in right ascension: half a pixel from the reference, of the scale that changes with Dec."""

SKY_STEP = 5e-5
"""Arcseconds: steps of a few arcseconds are rounded to a millionth of a pixel, along slightly curved parallels."""

ELECTRON_VOLT = 2e-7
"""Relative: astropy's interpreter of coordinates has an older value of it than its units."""

IBM_FLOAT = 2e-6
"""Relative: IBM's float32 has 20 to 24 bits, and its file was written from float32."""

ORBITAL_OVERLAP = 2e-3
"""Overlaps of Slater orbitals by the midpoint rule: the sharpest, exponent 5.95, decays within three of its steps."""

ELECTRON_IN_VIEW = 5e-3
"""What of an orbital's electron lies beyond the phantom's grid, and what the sum over its voxels misses."""

VOXEL_SUM = 1e-3
"""Relative, of the sum of Gaussians of at least 0.7 voxel against their integrals."""

IDEAL_HELIX_DEGREES = 1.0
"""Of the turn a residue: bond lengths of Engh and Huber with torsions that were published for slightly older ones."""

IDEAL_HELIX_RISE = 0.07
"""Å, of the rise a residue, likewise."""

CARBON_BOND = (1.19, 1.90)
"""Å: from C=O to C-S and P-O; what is nearer is a clash."""

SAME_ELEMENT_VOXELS = 0.999
"""Share of voxels that two programs give to the same element: where two atoms are equal, rounding decides."""

ALIASED_AMPLITUDE = 2e-3
"""Of F(000): what folds back into the transform of a density that is sampled twice as finely as is needed."""

CHANNEL = 0.2
"""Channels, of a mean velocity under the galaxy's noise."""

HELIX_PITCH = 0.02
"""Relative, of what is measured between peaks that are known to half a voxel, over 18 pairs of them."""

BALL_DIRECTION = 1e-3
"""Radians: the page is told the light's direction to four digits, and turns it a few times."""

BALANCED = 1.1
"""Times the mean, of the most that one of 16 boxes has to do: each cut lies within half a voxel, of 28 or more."""

SLAB_RIPPLE = 0.01
"""Of a slab's depth, from the thinnest pixel to the thickest, with the default kernel."""

# Of the pixels of step G, off by more than one level against exact positions and weights: where tables are steep, and
# the more the sharper the kernel is.
MISMATCHED_SLABS = 0.04

# Mean Laplacian of luminance, in 255ths, on a ball with a thin skin and a steep table in step G. It is 3.2; lit once,
# in the middle of each slab, it was 16.5.
MEAN_RING = 5.0

# Of a ball's mean alpha by step G, from the faintest side to the brightest: with a kernel without weights below 0, and
# with the default one, which overshoots at its rim; what leaves the table is set to its end.
UNEVEN_BALL, UNEVEN_BALL_OVERSHOT = 0.005, 0.006

# Of the pixels, whose field's byte two ways of computing round differently.
FEW_TIES = 0.002

EXACT_RAYS = 1e-6
"""Of what rays gather in closed form: float32 phantoms, and table positions that are rounded to float64."""

SLOPE_BY_DIFFERENCES = 1e-6
"""Of central differences over 1e-5 voxel, of densities near 1 in float64."""

CLOUD_LEVELS = 0.02  # mean over a picture: an exported Gaussian has no rim, and is sorted by depth, not by sheets
MESH_VOLUME = 0.02  # of a ball's volume: a mesh's faces cut corners, and its densities have 256 steps

# Brightness of level 1 over the volume's own where it takes its place, small volumes whose features are few voxels wide
# among them: 5 % is the worst there (docs/how_it_works/properties.md has the figures of a whole scan).
LEVEL_BRIGHTNESS = 0.06
THIN_LEVEL_BRIGHTNESS = 0.045  # of levels 1 and 2 where what is seen is two or three voxels thick: a benzene orbital's
ROD_JUMP = 0.025  # of the light where a level of rods, two or three voxels thick, is taken along the axes
ROD_BRIGHTNESS = 0.045  # against the volume itself, after two levels

# Light around a direction, 0..1: the mean that kernels take over few places, and the tests over many.
MEAN_LIGHT = 0.02
