"""What is shown to people: errors, names and numbers made fit to print, and never too many lines of it."""
