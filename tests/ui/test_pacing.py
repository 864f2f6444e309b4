"""The choice of the step that is drawn while things move."""

from hypothesis import given
from hypothesis import strategies as st

from volsplat.client.ui.viewing.pacing import StepPacing
from volsplat.protocol.description.scene import Step
from volsplat.protocol.rules.refinement import PAPER_STEPS

SECONDS = st.floats(1e-4, 10.0)


def test_the_coarsest_step_is_drawn_where_nothing_is_known() -> None:
    assert StepPacing().step_while_moving() == Step.A


def test_the_finest_step_that_holds_the_rate_is_chosen_even_where_a_coarser_one_does_not() -> None:
    pacing = StepPacing(images_per_second=10.0)
    for step, seconds in {Step.A: 0.01, Step.B: 0.02, Step.C: 0.3, Step.D: 0.05, Step.E: 0.06, Step.F: 0.2}.items():
        pacing.measured(step, seconds)
        pacing.measured(step, seconds)
    assert pacing.step_while_moving() in (Step.D, Step.E)


@given(st.dictionaries(st.sampled_from(PAPER_STEPS), SECONDS, min_size=1))
def test_what_is_chosen_is_expected_to_hold_the_rate(times: dict[Step, float]) -> None:
    pacing = StepPacing()
    for step, seconds in times.items():
        pacing.measured(step, seconds)
    chosen = pacing.step_while_moving()
    expected = pacing.expected(chosen)
    assert chosen == Step.A or (expected is not None and expected <= 1 / 30)


@given(SECONDS, SECONDS, st.floats(4.1, 50.0))
def test_a_step_that_becomes_much_slower_takes_the_others_along(a: float, f: float, factor: float) -> None:
    pacing = StepPacing()
    pacing.measured(Step.A, a)
    pacing.measured(Step.F, f)
    before = pacing.expected(Step.A)
    pacing.measured(Step.F, f * factor)
    after = pacing.expected(Step.A)
    assert before is not None and after is not None and after > before


def test_a_step_is_kept_while_its_times_vary_around_the_margin() -> None:
    pacing = StepPacing(images_per_second=30.0)
    for step, seconds in {Step.A: 0.003, Step.E: 0.020}.items():
        pacing.measured(step, seconds)
    for seconds in (0.030, 0.025, 0.032, 0.024):
        pacing.measured(Step.E, seconds)
        assert pacing.step_while_moving() == Step.E
    for _ in range(5):
        pacing.measured(Step.E, 0.040)
    assert pacing.step_while_moving() == Step.A
    for seconds in (0.0040, 0.0022, 0.0028):  # E is still thought to take too long
        pacing.measured(Step.A, seconds)
        assert pacing.step_while_moving() == Step.A
