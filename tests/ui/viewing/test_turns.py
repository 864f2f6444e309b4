"""Whose turn it is to draw with a session that several share."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from volsplat.client.session.turns import Turn, Turns, Urgency

URGENCIES = st.sampled_from(Urgency)


def waiting(turns: Turns, urgencies: list[Urgency]) -> list[Turn]:
    each = [Turn() for _ in urgencies]
    for turn, urgency in zip(each, urgencies, strict=True):
        turns.wait(turn, urgency)
    return each


@given(st.lists(URGENCIES, min_size=1))
def test_whoever_waits_for_a_free_session_has_it_in_the_end(urgencies: list[Urgency]) -> None:
    turns, served = Turns(), []
    each = waiting(turns, urgencies)
    while left := [turn for turn in each if turn not in served]:
        (turn,) = (turn for turn in left if turns.may_begin(turn))
        turns.begin(turn)
        turns.leave(turn)
        served.append(turn)
    assert served == sorted(each, key=lambda turn: turn.urgency)  # of one urgency as they came


@given(URGENCIES, URGENCIES)
def test_who_lost_a_turn_never_takes_it_back_from_who_took_it(has: Urgency, wants: Urgency) -> None:
    turns = Turns()
    (holder,) = waiting(turns, [has])
    turns.begin(holder)
    (other,) = waiting(turns, [wants])
    if turns.may_begin(other):
        turns.begin(other)
        turns.leave(holder)
        turns.wait(holder, Urgency.OWED)
        assert not turns.may_begin(holder)
        assert turns.holder is other


@given(URGENCIES)
def test_a_script_waits_only_for_a_hand_and_for_who_lost_a_turn(urgency: Urgency) -> None:
    turns = Turns()
    first = urgency in (Urgency.OVERDUE, Urgency.MOVING, Urgency.OWED)
    (turn,) = waiting(turns, [urgency])
    assert turns.scripts_wait == first
    turns.outright.add(1)  # what the script asked for before is still drawn: what it asks for now takes its place
    assert turns.scripts_wait == (urgency is Urgency.OVERDUE)  # else scripts in turn might keep it out for good
    assert turns.may_begin(turn) == (urgency is Urgency.MOVING)
    turns.outright.clear()
    turns.begin(turn)
    assert turns.scripts_wait == first


@given(URGENCIES)
def test_nobody_takes_the_place_of_what_a_script_is_overdue_with(urgency: Urgency) -> None:
    turns = Turns()
    (turn,) = waiting(turns, [urgency])
    with turns.script_overdue():
        assert turns.may_begin(turn) == (urgency is not Urgency.MOVING)
        turns.ask_outright(1, overdue=True)
    assert not turns.may_begin(turn)
    turns.end(1)
    assert turns.may_begin(turn)


@given(URGENCIES)
def test_an_overdue_turn_has_one_picture_finished_and_gives_way_then(urgency: Urgency) -> None:
    turns = Turns()
    (overdue,) = waiting(turns, [Urgency.OVERDUE])
    turns.begin(overdue)
    overdue.frame = 7
    (other,) = waiting(turns, [urgency])
    assert not turns.may_begin(other)
    assert turns.scripts_wait and turns.overdue_scripts_wait
    turns.finish(6)
    assert not turns.may_begin(other)
    turns.finish(7)
    assert turns.may_begin(other) == (urgency < Urgency.OWED)
    assert not turns.overdue_scripts_wait


def test_the_picture_that_a_hand_moves_is_finished_before_what_is_overdue() -> None:
    turns = Turns()
    (hand,) = waiting(turns, [Urgency.MOVING])
    turns.begin(hand)
    overdue, again = waiting(turns, [Urgency.OVERDUE, Urgency.MOVING])
    assert not turns.may_begin(overdue)
    assert turns.overdue_scripts_wait
    turns.leave(hand)
    assert turns.may_begin(overdue) and not turns.may_begin(again)
