"""A volume open for drawing, by servers or in a single process."""
