"""Files that take their names once they are whole."""
