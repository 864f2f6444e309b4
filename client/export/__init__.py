"""What leaves for other programs: a volume's visible voxels as 3-D Gaussians, and a surface of it as a mesh."""
