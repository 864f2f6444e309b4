"""What a script or notebook calls in one line: draw a volume, show it, look at it in the browser."""
