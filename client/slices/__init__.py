"""Slices of the volume: put together from what servers hold of them, and as pictures."""
