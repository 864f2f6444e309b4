"""What a server holds of a volume: sub-cubes of voxel packets, however they came to it, and which volume it is."""
