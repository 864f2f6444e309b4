"""A frame whose light the volume dims: what dims it is asked of all who hold the volume, once, before the frame is."""

import struct

import msgspec
import pytest

from support.messages.coordinated import (
    DESCRIPTION,
    FIRST,
    SCENE,
    SECOND,
    SPLAT,
    CheckedCoordinator,
    packed,
    said,
    sent,
    surveyed,
)
from volsplat.client.coordinator.events.events import FrameAsked, MessageReceived, ServerLost
from volsplat.client.coordinator.events.instructions import CutOff, EndFrame, Instruction, Send
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Light, Scene, View
from volsplat.protocol.description.shading_tables import CrossBar, Field, ScalarTable
from volsplat.protocol.messages import messages
from volsplat.protocol.text.errors import BadInput

BLOCKS = DESCRIPTION.geometry.dims  # 8 x 9 x 10 voxels: each is a block
COUNT = 720
SHADOWED = msgspec.structs.replace(SCENE, light=Light(shadows=0.5, occlusion=0.25))
ASK_BOTH = [(FIRST, messages.SumDepths), (SECOND, messages.SumDepths)]
RENDER = [(server, messages.RenderFrame) for server in (FIRST, SECOND, SPLAT)]


def asked(coordinator: CheckedCoordinator, frame: int, scene: Scene = SHADOWED) -> list[Instruction]:
    return coordinator.handle(FrameAsked(frame, scene, Step.G, require_complete=True))


def summed(server: int, frame: int, depth: int = 0, assignment: int = 1) -> MessageReceived:
    told = messages.DepthsSummed(frame, assignment, BLOCKS)
    return said(server, told, struct.pack(f"<{COUNT}Q", *[depth] * COUNT))


def waiting() -> CheckedCoordinator:
    """Frame 1 waits for both."""
    coordinator = surveyed()
    asked(coordinator, 1)
    assert sent(packed(coordinator)) == ASK_BOTH
    return coordinator


def drawn() -> CheckedCoordinator:
    coordinator = waiting()
    for server in (FIRST, SECOND):
        coordinator.handle(summed(server, 1))
    return coordinator


def requests(told: list[Instruction]) -> dict[int, messages.RenderFrame]:
    return {i.server: i.message for i in told if isinstance(i, Send) and isinstance(i.message, messages.RenderFrame)}


def test_a_frame_waits_for_all_sums_and_splat_servers_alone_get_them() -> None:
    coordinator = waiting()
    assert coordinator.handle(summed(SECOND, 1, 65536)) == []
    told = coordinator.handle(summed(FIRST, 1, 65536 * 3 + 7))
    assert sent(told) == RENDER
    frames = requests(told)
    light = frames[SPLAT].light
    assert light is not None and frames[FIRST].light is frames[SECOND].light is None
    assert (light.dims, light.size, light.shadows, light.occlusion) == (BLOCKS, (1, 1, 1), 0.5, 0.25)
    assert struct.unpack(f"<{COUNT}H", light.depths) == (4 * 4096,) * COUNT


def test_what_is_deeper_than_fits_is_as_deep_as_fits() -> None:
    coordinator = waiting()
    coordinator.handle(summed(SECOND, 1, 1 << 40))
    light = requests(coordinator.handle(summed(FIRST, 1)))[SPLAT].light
    assert light is not None and set(struct.unpack(f"<{COUNT}H", light.depths)) == {65535}


def test_a_turn_and_other_amounts_need_no_more_sums_and_other_tables_do() -> None:
    coordinator = drawn()
    turned = msgspec.structs.replace(SHADOWED, view=View(rotation=(0.1, 0.2, 0.3, 0.9)), light=Light(occlusion=1.0))
    assert sent(asked(coordinator, 2, turned))[-3:] == RENDER
    clear = msgspec.structs.replace(SHADOWED.tables, opac=ScalarTable(points=((0.5, 0.1),)))
    told = asked(coordinator, 3, msgspec.structs.replace(SHADOWED, tables=clear))
    assert sent(told) == [*((server, messages.AbortFrame) for server in (FIRST, SECOND, SPLAT)), *ASK_BOTH]


def test_a_turn_needs_more_if_a_place_on_the_screen_decides_what_is_opaque() -> None:
    by_screen = msgspec.structs.replace(SHADOWED, cross_bar=CrossBar(modu=Field.SCREEN_Z))
    coordinator = surveyed()
    asked(coordinator, 1, by_screen)
    packed(coordinator)
    for server in (FIRST, SECOND):
        coordinator.handle(summed(server, 1))
    turned = msgspec.structs.replace(by_screen, view=View(rotation=(0.1, 0.2, 0.3, 0.9)))
    assert sent(asked(coordinator, 2, turned))[-2:] == ASK_BOTH


@pytest.mark.parametrize("step", [Step.A, Step.F])
def test_other_steps_ask_nobody(step: Step) -> None:
    coordinator = surveyed()
    coordinator.handle(FrameAsked(1, SHADOWED, step, require_complete=True))
    assert sent(packed(coordinator)) == RENDER


def test_a_newer_frame_asks_anew_and_older_answers_count_for_nothing() -> None:
    coordinator = waiting()
    coordinator.handle(summed(FIRST, 1))
    told = asked(coordinator, 2)
    assert EndFrame(1) in told and sent(told) == ASK_BOTH
    assert coordinator.handle(summed(SECOND, 1)) == []
    assert coordinator.handle(summed(SECOND, 2)) == []
    assert sent(coordinator.handle(summed(FIRST, 2))) == RENDER


def test_a_server_that_refuses_ends_the_frame_and_the_next_one_asks_again() -> None:
    coordinator = waiting()
    (ended,) = coordinator.handle(said(FIRST, messages.Refused("SumDepths", "no memory", frame=1, assignment=1)))
    assert isinstance(ended, EndFrame) and isinstance(ended.error, BadInput) and str(ended.error) == "no memory"
    assert sent(asked(coordinator, 2)) == ASK_BOTH


def test_the_loss_of_a_server_ends_the_frame_that_waits_for_it() -> None:
    coordinator = waiting()
    told = coordinator.handle(ServerLost(FIRST, "gone"))
    assert any(isinstance(i, EndFrame) and i.frame == 1 and i.error is not None for i in told)
    assert coordinator.handle(summed(SECOND, 1)) == []


def test_who_sums_up_other_blocks_is_cut_off() -> None:
    coordinator = waiting()
    told = coordinator.handle(said(FIRST, messages.DepthsSummed(1, 1, (1, 1, 1)), bytes(8)))
    assert [i.server for i in told if isinstance(i, CutOff)] == [FIRST]
