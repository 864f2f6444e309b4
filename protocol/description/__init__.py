"""What is drawn: the volume, its kind and name, and the scene."""
