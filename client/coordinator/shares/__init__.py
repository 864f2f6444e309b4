"""What each server gets: which part of the volume, which part of the image, by how much work each is."""
