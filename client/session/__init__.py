"""A volume open for drawing, by servers or in a single process, and what is reported of its frames."""
