"""Tunnels: what ssh carries for servers of machines that nothing but ssh reaches."""
