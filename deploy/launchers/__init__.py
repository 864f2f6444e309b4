"""Launchers: each starts servers by an engine that exists, and asks it of them."""
