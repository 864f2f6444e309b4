"""The `volsplat` command and its sub-commands."""
