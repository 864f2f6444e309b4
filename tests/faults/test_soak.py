"""Turning and changing, with a map/shade server killed again and again: nothing grows."""

import random

from faults.soak import soak

from support.thoroughness import THOROUGH

KILLS = 8


def test_what_processes_hold_stays_flat() -> None:
    """`python -m faults.soak` does it for half an hour."""
    seed = random.randrange(1 << 30)
    print(f"seed {seed}")
    seconds = 120.0 if THOROUGH else 32.0
    early, late = soak(seed, seconds, kill_every=seconds / KILLS, say=print)
    assert not late.grown(early)
