"""Arrays of any field: HDF5, NetCDF, NumPy and raw voxels."""
