"""`volsplat bench` and its sub-commands."""
