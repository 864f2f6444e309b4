"""Other renderers that volsplat is measured against, made to draw the same scenes."""
