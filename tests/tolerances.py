"""Every tolerance of the tests, with its reason. Tests never type a number of their own."""

ONE_LEVEL = 1 / 255
"""One level of an 8-bit display: what nobody can see (design, section 4)."""

ROTATION_ENTRY = 1e-14
"""Entries of a rotation made from a quaternion in float64: a few dozen roundings of numbers up to 1."""
