"""The choice of what is drawn while things move."""

from hypothesis import given
from hypothesis import strategies as st

from support.scenes.arbitrary import plain_scene
from volsplat.client.ui.viewing.pacing import LEAST_SIDE, Pacing, Rung, ladder
from volsplat.protocol.description.scene import Step
from volsplat.protocol.rules.refinement import PAPER_STEPS

SECONDS = st.floats(1e-4, 10.0)
SCENE = plain_scene(size=(512, 512))
RUNGS = ladder(SCENE)


def test_what_is_the_fastest_is_drawn_if_nothing_is_known() -> None:
    assert Pacing().while_moving(SCENE) == RUNGS[0]


def test_below_the_whole_image_come_smaller_ones_of_the_finest_step_and_then_fewer_voxels() -> None:
    assert {rung.step for rung in RUNGS} == {Step.F}
    assert [rung.octaves for rung in RUNGS] == [2, 1, *[0] * (len(RUNGS) - 2)]
    shares = [rung.share for rung in RUNGS]
    assert shares[0] == shares[1] == shares[2] and shares[2:] == sorted(shares[2:])
    assert shares[-1] == 1.0 and len(shares) > 4
    assert all(512 * share >= LEAST_SIDE for share in shares)
    assert ladder(plain_scene(size=(LEAST_SIDE, 900))) == [Rung(step) for step in PAPER_STEPS]


def test_the_best_that_holds_the_rate_is_chosen_even_if_a_coarser_step_does_not() -> None:
    pacing = Pacing(images_per_second=10.0)
    for rung, seconds in zip(RUNGS, (0.01, 0.02, 0.3, 0.05, 0.06), strict=False):
        pacing.measured(rung, seconds)
    assert pacing.while_moving(SCENE) == RUNGS[4]


def test_a_smaller_image_is_expected_to_hold_by_the_whole_ones_time_and_then_by_its_own() -> None:
    pacing = Pacing(images_per_second=10.0)
    pacing.measured(Rung(Step.A), 0.01)
    pacing.measured(Rung(Step.F), 0.12)
    smaller = pacing.while_moving(SCENE)
    assert smaller.step is Step.F and smaller.share < 1.0
    for _ in range(9):
        pacing.measured(smaller, 0.11)
    assert pacing.while_moving(SCENE) < smaller


def test_what_was_slow_once_is_tried_again_after_the_next_whole_image() -> None:
    pacing = Pacing()
    pacing.measured(Rung(Step.F), 0.04)
    for _ in range(20):  # while other programs took the machine
        pacing.measured(pacing.while_moving(SCENE), 0.5)
    assert pacing.while_moving(SCENE) == RUNGS[0]
    for _ in range(9):
        pacing.measured(Rung(Step.F), 0.04)
    assert pacing.while_moving(SCENE).octaves == 0


@given(st.dictionaries(st.sampled_from(RUNGS), SECONDS, min_size=1))
def test_what_is_chosen_is_expected_to_hold_the_rate(times: dict[Rung, float]) -> None:
    pacing = Pacing()
    for rung, seconds in times.items():
        pacing.measured(rung, seconds)
    chosen = pacing.while_moving(SCENE)
    expected = pacing.expected(chosen)
    smallest = next(rung for rung in RUNGS if rung.step is Step.F and rung.octaves == 0)
    patience = 1.6 if chosen == smallest else 1.0
    assert chosen == RUNGS[0] or (expected is not None and expected <= patience / 30)


@given(SECONDS, SECONDS, st.floats(4.1, 50.0))
def test_a_step_that_becomes_much_slower_takes_the_others_along(a: float, f: float, factor: float) -> None:
    pacing = Pacing()
    pacing.measured(Rung(Step.A), a)
    pacing.measured(Rung(Step.F), f)
    before = pacing.expected(Rung(Step.A))
    pacing.measured(Rung(Step.F), f * factor)
    after = pacing.expected(Rung(Step.A))
    assert before is not None and after is not None and after > before


def test_what_is_drawn_is_kept_while_its_times_vary_around_the_margin() -> None:
    pacing = Pacing(images_per_second=30.0)
    fastest, strided = RUNGS[:2]
    for rung, seconds in {fastest: 0.003, strided: 0.020}.items():
        pacing.measured(rung, seconds)
    assert pacing.while_moving(SCENE) == strided
    for seconds in (0.030, 0.025, 0.032, 0.024):
        pacing.measured(strided, seconds)
        assert pacing.while_moving(SCENE) == strided
    for _ in range(5):
        pacing.measured(strided, 0.040)
    assert pacing.while_moving(SCENE) == fastest
    for seconds in (0.0040, 0.0022, 0.0028):  # that is still thought to take too long
        pacing.measured(fastest, seconds)
        assert pacing.while_moving(SCENE) == fastest
