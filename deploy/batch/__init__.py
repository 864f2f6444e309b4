"""Batch work: a program's tasks, done by many machines through the engine that they run."""
