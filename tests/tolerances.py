"""Every tolerance of the tests, with its reason. Tests never type a number of their own."""

ONE_LEVEL = 1 / 255
"""One level of an 8-bit display: what nobody can see (design, section 4)."""

ROTATION_ENTRY = 1e-14
"""Entries of a rotation made from a quaternion in float64: a few dozen roundings of numbers up to 1."""

ROUNDING = 1e-9
"""Of numbers near 1 after some dozens of float64 operations."""

HALF_A_LATTICE_STEP = 1 / 128
"""Positions are rounded to 1/64 pixel (design, section 3.6)."""

DDA_DRIFT = 1e-6
"""Pixels: half steps are rounded to 2^-32, and some thousands of them add up."""

HALF_A_LEVEL = {"uint8": 0.5 / 255 + 1e-6, "uint16": 0.5 / 65535 + 1e-6, "float": 0.0}
"""What rounding to a file's pixels may change; float32 itself holds 0..1 to 6e-8."""

JPEG_LEVELS = 6 / 255
"""JPEG of quality 95 on smooth ramps: quantised coefficients, and YCbCr rounded to 8 bits."""

QUADRATURE = 1e-6
"""Of integrals by 96 points over profiles whose second derivative may jump."""

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
