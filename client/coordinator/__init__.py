"""Divides the volume among map/shade servers, follows what each holds, and brings frames about."""
