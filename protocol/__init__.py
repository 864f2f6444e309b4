"""The shared vocabulary of the three programs: scene, volume, frame plan, index rules, messages and framing.

It imports no other part of volsplat.
"""
