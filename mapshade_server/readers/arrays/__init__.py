"""Arrays of any field: Zarr, HDF5, NumPy, VTK images and raw voxels."""
