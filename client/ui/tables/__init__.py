"""The editor of the shading tables."""
