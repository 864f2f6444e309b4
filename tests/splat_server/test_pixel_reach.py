"""What of an image a frame reaches, as far as it is known beforehand."""

from __future__ import annotations

import itertools

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.scenes.arbitrary import plain_scene
from volsplat.protocol.description.scene import Image, Step, View
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.rules.frame_plan import plan_frame
from volsplat.splat_server._kernels import FootprintTable
from volsplat.splat_server.pixel_reach import busy_rows, pixel_reach


@given(
    st.tuples(*[st.integers(1, 40)] * 3),
    st.tuples(*[st.floats(-1, 1)] * 3),
    st.floats(0.3, 20),
    st.sampled_from(Step),
)
def test_busy_rows_are_those_between_the_volume_s_corners(
    dims: tuple[int, int, int], turn: tuple[float, float, float], zoom: float, step: Step
) -> None:
    view, image = View(rotation=(*turn, 1.0), zoom=zoom), Image(width=120, height=90)
    scene = msgspec.structs.replace(plain_scene(view=view), image=image)
    plan = plan_frame(scene, Geometry(dims), step)
    reach = pixel_reach(plan)
    corners = itertools.product(*((2 * visits.low - 1, 2 * visits.high - 1) for visits in plan.visits))
    at = [plan.y.at_half_indices((i, j, k)) / 2**32 for i, j, k in corners]
    around = reach.height // 2 if isinstance(reach, FootprintTable) else 0
    first, end = busy_rows(plan, reach)
    assert first == pytest.approx(min(max(min(at) - around, 0), plan.height), abs=1)
    assert end == pytest.approx(min(max(max(at) + around + 1, 0), plan.height), abs=1)
