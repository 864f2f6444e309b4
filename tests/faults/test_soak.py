"""Two minutes of turning and changing, with a map/shade server killed every fifteen seconds: nothing grows."""

import random

from faults.soak import soak


def test_what_processes_hold_stays_flat() -> None:
    seed = random.randrange(1 << 30)
    print(f"seed {seed}")
    early, late = soak(seed, seconds=120.0, kill_every=15.0, say=print)
    assert not late.grown(early)
