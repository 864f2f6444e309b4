"""Frames: the tables that shade them, the walk through what is held, and how its batches are delivered."""
