"""Seismic surveys: SEG-Y."""
