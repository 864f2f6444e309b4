"""Movies: key frames, frames between them, and the file."""
