"""Starts the servers' processes."""
