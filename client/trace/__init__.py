"""Traces: what every process was at while frames were drawn, in a file that viewers of traces load."""
