"""Files that take their names once they are whole, and folders for as long as somebody needs them."""
