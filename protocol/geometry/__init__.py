"""Rotations and which way is up."""
