"""How many voxels have which values, and what stands out among them."""
