"""Volumes that lie in a script's memory: what their libraries tell of them, and how servers get to read them."""
