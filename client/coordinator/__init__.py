"""Divides the volume among servers, follows what each holds, and has frames drawn."""
