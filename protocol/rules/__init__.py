"""What every process must work out alike: levels, lattices, the order of voxels, footprints, packet bits."""
