"""The choice of what is drawn while things move."""

from __future__ import annotations

import random
from collections.abc import Iterator
from itertools import pairwise
from typing import Literal

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.scenes.arbitrary import plain_scene
from volsplat.client.ui.viewing.image_size import scaled
from volsplat.client.ui.viewing.pacing import (
    ALMOST_OPAQUE,
    FEWER,
    FEWEST,
    LEAST_SIDE,
    LEAST_THINNED_SIDE,
    Pacing,
    Rung,
    ladder,
)
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Kernel, Reconstruction, Refine
from volsplat.protocol.rules.footprint_shape import kernel_radius
from volsplat.protocol.rules.levels import ALL_VOXELS, Thinning
from volsplat.protocol.rules.refinement import PAPER_STEPS

SECONDS = st.floats(1e-4, 10.0)
SCENE = plain_scene(size=(512, 512))
RUNGS = ladder(SCENE)
WHOLE = RUNGS[-1]
# Milliseconds of each rung: shells of 256 x 256 x 256 voxels (from processor time), a CT head of 96 x 128 x 113.
SHELLS = (5.6, 6.4, 8.9, 11.0, 19.3, 25.9, 36.5, 52.0, 55.0, 57.0)
HEAD = (3.6, 3.9, 4.4, 5.3, 6.0, 6.5, 7.3, 8.3, 9.0, 12.0)
WARM_UP = 60  # images, in which what rungs cost is found out


def dragged(pacing: Pacing, milliseconds: tuple[float, ...], images: int, noise: float = 0.0) -> Iterator[int]:
    """The places on the ladder of so many moving images, each of which takes what its rung does, more or less."""
    vary = random.Random(1)
    for _ in range(images):
        rung = pacing.while_moving(SCENE)
        place = RUNGS.index(rung)
        pacing.measured(rung, milliseconds[place] / 1e3 * vary.uniform(1 - noise, 1 + noise))
        yield place


def test_what_is_the_fastest_is_drawn_if_nothing_is_known() -> None:
    assert Pacing().while_moving(SCENE) == RUNGS[0]


def test_below_the_whole_image_come_smaller_ones_and_then_fewer_voxels() -> None:
    assert {rung.step for rung in RUNGS} == {Step.F} and len(RUNGS) == len(SHELLS)
    assert WHOLE == Rung(Step.F) and WHOLE.is_whole
    thinned = [rung for rung in RUNGS if rung.thinning != ALL_VOXELS]
    assert RUNGS[: len(thinned)] == thinned
    left = [1 / rung.thinning.one_in for rung in RUNGS]
    assert left == sorted(left) and left[0] == 1 / 64 and left[len(thinned) - 1] == 1 / 2
    for some, least in ((thinned, LEAST_THINNED_SIDE), (RUNGS[len(thinned) :], LEAST_SIDE)):
        shares = [rung.share for rung in some]
        assert shares == sorted(shares) and all(512 * share >= least for share in shares)


def test_all_but_the_whole_image_leave_out_what_almost_opaque_pixels_hide() -> None:
    assert WHOLE.left_out == ALL_VOXELS  # it may stay
    for rung in RUNGS[:-1]:
        assert rung.left_out == rung.thinning._replace(frozen_alpha=ALMOST_OPAQUE)


@pytest.mark.parametrize("finest", [Step.D, Step.E, Step.F, Step.G])
def test_steps_with_footprints_have_the_same_ladder(finest: Step) -> None:
    scene = msgspec.structs.replace(SCENE, refine=Refine(finest=finest))
    assert ladder(scene) == [rung._replace(step=min(finest, Step.F)) for rung in RUNGS]


@pytest.mark.parametrize("finest", [Step.A, Step.B, Step.C])
def test_steps_without_footprints_are_drawn_whole_up_to_the_one_that_is_asked_for(finest: Step) -> None:
    scene = msgspec.structs.replace(SCENE, refine=Refine(finest=finest))
    assert ladder(scene) == [Rung(step) for step in Step if step <= finest]
    pacing = Pacing()
    assert pacing.while_moving(scene) == Rung(Step.A)
    for n, step in enumerate(Step[s] for s in "ABC"):
        pacing.measured_at_rest(step, 0.01 * 2**n)
    assert pacing.while_moving(scene) == Rung(min(finest, Step.B)), "C takes 40 ms"


@pytest.mark.parametrize("kernel", Kernel)
@pytest.mark.parametrize("radius", ["default", 1.2, 1.5, 3.0])
def test_all_but_the_whole_image_cut_the_default_kernel_nearer_and_never_farther(
    kernel: Kernel, radius: float | Literal["default"]
) -> None:
    scene = msgspec.structs.replace(SCENE, reconstruction=Reconstruction(kernel=kernel, radius=radius))
    own = kernel_radius(scene.reconstruction)
    assert WHOLE.drawn(scene) == scene
    for rung in RUNGS[:-1]:
        drawn = rung.drawn(scene)
        assert kernel_radius(drawn.reconstruction) == (min(own, 1.5) if kernel is Kernel.GAUSSIAN else own)
        assert msgspec.structs.replace(drawn, reconstruction=scene.reconstruction) == scaled(scene, rung.share)


def test_a_small_image_is_drawn_whole_and_lit_however_few_its_voxels() -> None:
    small = ladder(plain_scene(size=(LEAST_SIDE, 900)))
    assert small == [*(Rung(Step.F, 1.0, thinning) for thinning in (*FEWEST, FEWER[-1])), Rung(Step.F)]


@pytest.mark.parametrize("side", [100, LEAST_SIDE, 400, 512, 700, 2160])
def test_no_way_to_draw_is_on_the_ladder_twice(side: int) -> None:
    rungs = ladder(plain_scene(size=(side, side)))
    assert len(set(rungs)) == len(rungs)


@pytest.mark.parametrize(
    ("milliseconds", "best"),
    [(SHELLS, 5), (HEAD, 9), (tuple(2 * t for t in SHELLS), 3), (tuple(4 * t for t in SHELLS), 1)],
)
@pytest.mark.parametrize("noise", [0.0, 0.15])
def test_the_best_that_holds_the_rate_is_found_and_kept(
    milliseconds: tuple[float, ...], best: int, noise: float
) -> None:
    pacing = Pacing()
    pacing.measured_at_rest(Step.F, milliseconds[-1] / 1e3)
    places = list(dragged(pacing, milliseconds, 300, noise))[WARM_UP:]
    assert sum(place == best for place in places) > 0.8 * len(places)
    assert all(milliseconds[place] < 1e3 / 30 for place in places if places.count(place) > 0.05 * len(places))


@pytest.mark.parametrize("milliseconds", [SHELLS, HEAD])
def test_pictures_hardly_change_their_looks_while_times_vary(milliseconds: tuple[float, ...]) -> None:
    pacing = Pacing()
    pacing.measured_at_rest(Step.F, milliseconds[-1] / 1e3)
    places = list(dragged(pacing, milliseconds, 600, noise=0.2))[WARM_UP:]
    assert sum(one != other for one, other in pairwise(places)) < len(places) / 20


# Of a machine on which almost all of the shells' rungs hold the rate, and the last but one just does.
QUICK = (5.0, 5.5, 7.0, 9.0, 11.0, 14.0, 16.0, 22.0, 28.0, 38.0)


def test_pictures_at_rest_that_are_held_up_make_no_drag_worse() -> None:
    """By a page that takes in other pictures, for which nothing that moves can be blamed."""
    pacing = Pacing()
    pacing.measured_at_rest(Step.F, QUICK[-1] / 1e3)
    *_, best = dragged(pacing, QUICK, WARM_UP)
    for _ in range(20):
        pacing.measured_at_rest(Step.F, 1.7 * QUICK[-1] / 1e3)
        places = list(dragged(pacing, QUICK, 40, noise=0.15))
        assert min(places) >= best - 1 and places[-1] == best, places


def test_while_other_programs_take_the_machine_less_is_drawn_and_then_as_much_as_before() -> None:
    pacing = Pacing()
    pacing.measured_at_rest(Step.F, HEAD[-1] / 1e3)
    before = list(dragged(pacing, HEAD, WARM_UP))[-1]
    busy = list(dragged(pacing, tuple(5 * t for t in HEAD), WARM_UP))[-1]
    after = list(dragged(pacing, HEAD, 2 * WARM_UP))[-1]
    assert busy < before == after
    assert 5 * HEAD[busy] < 1e3 / 30


@pytest.mark.parametrize("milliseconds", [SHELLS, HEAD])
def test_one_image_that_took_long_changes_nothing(milliseconds: tuple[float, ...]) -> None:
    pacing = Pacing()
    pacing.measured_at_rest(Step.F, milliseconds[-1] / 1e3)
    *_, place = dragged(pacing, milliseconds, WARM_UP)
    pacing.measured(RUNGS[place], 1.0)
    assert pacing.while_moving(SCENE) == RUNGS[place]


def test_neither_does_one_before_a_rest_and_one_after_it() -> None:
    pacing = Pacing()
    pacing.measured_at_rest(Step.F, HEAD[-1] / 1e3)
    list(dragged(pacing, HEAD, WARM_UP))
    pacing.measured(WHOLE, 0.15)
    pacing.measured_at_rest(Step.F, HEAD[-1] / 1e3)
    pacing.measured(WHOLE, 0.15)
    assert list(dragged(pacing, HEAD, 20)) == 20 * [len(HEAD) - 1]


@pytest.mark.parametrize("every", [2, 3])
@pytest.mark.parametrize("milliseconds", [SHELLS, HEAD])
def test_images_that_take_long_again_and_again_have_less_drawn(milliseconds: tuple[float, ...], every: int) -> None:
    """Although most, and each before such a one, do not."""
    pacing = Pacing()
    pacing.measured_at_rest(Step.F, milliseconds[-1] / 1e3)
    *_, before = dragged(pacing, milliseconds, WARM_UP)
    places = list[int]()
    for n in range(4 * WARM_UP):
        rung = pacing.while_moving(SCENE)
        places.append(RUNGS.index(rung))
        pacing.measured(rung, milliseconds[places[-1]] / 1e3 * (1 if n % every else 10))
    assert sum(places[WARM_UP:]) / len(places[WARM_UP:]) < before - 2


def test_a_picture_at_rest_that_took_far_longer_than_before_says_how_long_others_take() -> None:
    pacing = Pacing()
    for seconds in (0.02, 0.5):  # of other tables
        pacing.measured_at_rest(Step.F, seconds)
    assert pacing.expected(WHOLE) == 0.5


def test_a_picture_at_rest_that_was_held_up_has_nothing_worse_drawn_next() -> None:
    pacing = Pacing()
    pacing.measured_at_rest(Step.F, SHELLS[-1] / 1e3)
    *_, place = dragged(pacing, SHELLS, WARM_UP)
    for step in PAPER_STEPS[:-1]:
        pacing.measured_at_rest(step, 0.01)
    pacing.measured_at_rest(Step.F, 1.5 * SHELLS[-1] / 1e3)
    assert pacing.while_moving(SCENE) == RUNGS[place]


def test_what_was_slow_once_is_tried_again_after_the_next_whole_images() -> None:
    pacing = Pacing()
    pacing.measured_at_rest(Step.F, 0.04)
    for _ in range(20):  # while other programs took the machine
        pacing.measured(pacing.while_moving(SCENE), 0.5)
    assert pacing.while_moving(SCENE) == RUNGS[0]
    for _ in range(9):
        pacing.measured_at_rest(Step.F, 0.04)
    assert pacing.while_moving(SCENE).thinning in (ALL_VOXELS, Thinning(sheets=2))


@given(st.lists(st.tuples(st.sampled_from(RUNGS), SECONDS), min_size=1))
def test_what_is_chosen_anew_is_expected_to_hold_the_rate(times: list[tuple[Rung, float]]) -> None:
    pacing = Pacing()
    for rung, seconds in times:
        pacing.measured(rung, seconds)
    chosen = pacing.while_moving(SCENE)
    expected = pacing.expected(chosen)
    assert chosen == RUNGS[0] or (expected is not None and expected <= 1 / 30)


@given(SECONDS, st.floats(2.1, 50.0), st.sampled_from(RUNGS[:-1]))
def test_a_whole_image_that_becomes_far_slower_takes_the_others_along(
    seconds: float, factor: float, rung: Rung
) -> None:
    pacing = Pacing()
    pacing.measured_at_rest(Step.F, seconds)
    before = pacing.expected(rung)
    pacing.measured_at_rest(Step.F, seconds * factor)
    after = pacing.expected(rung)
    assert before is not None and after is not None and after > before
    assert after < seconds * factor
