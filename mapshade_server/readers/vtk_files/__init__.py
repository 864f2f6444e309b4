"""VTK's own image and grid files."""
