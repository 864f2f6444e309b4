"""Servers are harmed at random moments: no image is wrong, and none is waited for without end."""

import random
import time

import pytest
from faults.disk_runs import disk_runs
from faults.fault_runs import Aftermath, Bench, Opened, at_hand, drawn_head, fault_runs, in_box, summary
from faults.kinds_of_fault import FAULTS, Fault
from faults.servers_at_hand import ServersAtHand

from support.lab.box import why_no_box
from support.lab.host_network import why_unharmed
from support.thoroughness import THOROUGH
from volsplat.deploy.server_command import Program

SECONDS = 120.0 if THOROUGH else 10.0  # of faults; `python -m faults.fault_runs` does hundreds
TIME_TO_JOIN = 6.0  # seconds, for one that is started when another falls silent
WHY_NO_BOX = why_no_box() or why_unharmed()


def seen_for_a_while(opened: Opened) -> list[Aftermath]:
    seed = random.randrange(1 << 30)
    print(f"seed {seed}")
    until = time.monotonic() + SECONDS
    seen = fault_runs(seed, lambda done: not done or time.monotonic() < until, print, opened)
    print(summary(seen))
    return seen


def test_no_fault_makes_a_wrong_image_or_a_hang_and_none_ends_a_session_but_the_loss_of_an_only_server() -> None:
    seen = seen_for_a_while(at_hand)
    assert not any(after.wrong or after.hung for after in seen)
    assert [after for after in seen if after.ended and not (after.only_one and after.fault.loses)] == []
    assert all(after.seconds for after in seen if not after.ended), "each other session is whole again"


@pytest.mark.skipif(bool(WHY_NO_BOX), reason=WHY_NO_BOX)
def test_nor_does_one_in_a_box_or_end_a_session() -> None:
    with in_box() as opened:
        assert not any(after.wrong or after.hung or after.ended for after in seen_for_a_while(opened))


def test_a_disk_that_fills_up_damages_no_image() -> None:
    seen = disk_runs(random.randrange(1 << 30), lambda done: done < 8, print)
    assert not any(after.damaged > 0 or after.hung for after in seen) and any(after.refused > 0 for after in seen)


@pytest.mark.parametrize("fault", [fault for fault in FAULTS if fault.silent], ids=lambda fault: fault.name)
def test_what_the_only_map_shade_server_held_goes_to_one_that_came_before_its_loss_was_noticed(fault: Fault) -> None:
    with drawn_head() as head:
        chance = random.Random(1)
        servers = ServersAtHand(head.volume, chance, workers=1, splat_servers=1, silence=TIME_TO_JOIN)
        bench = Bench(head, chance, servers)
        try:
            after = bench.suffers(fault, of=[Program.MAPSHADE_SERVER])
        finally:
            bench.close()
    assert after.seconds and not (after.hung or after.ended or after.wrong), after
