"""Zarr arrays, in folders, archives and on the web."""
