"""The page in the browser: the volume, and every control of the scene."""
