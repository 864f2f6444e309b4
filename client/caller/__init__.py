"""What a caller or a person hands in, and how they interrupt."""
