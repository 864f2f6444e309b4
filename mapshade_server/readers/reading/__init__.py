"""What readers of every format share."""
