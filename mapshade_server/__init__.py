"""The map/shade server: reads its sub-cube, makes voxel packets, and maps and shades them for each frame."""
