"""Spectral cubes: FITS."""
