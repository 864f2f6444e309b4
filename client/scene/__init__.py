"""Scenes: made for a volume, by a preset, or read from a file."""
