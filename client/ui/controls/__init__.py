"""Widgets that follow the scene and that a hand may move."""
