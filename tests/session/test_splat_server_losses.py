"""Splat servers answer in any order, are lost or silent: every frame ends, and the next one is whole."""

from collections import deque
from random import Random

from hypothesis import given
from hypothesis import strategies as st

from support.messages.coordinated import (
    FIRST,
    SECOND,
    said,
)
from support.messages.drawn import (
    BIG,
    GONE,
    THREE,
    check_whole,
    drawing_big,
    finished,
    image,
    mapped,
    rectangles,
    running,
)
from volsplat.client.coordinator.events.events import (
    AbortAsked,
    Event,
    FrameAsked,
    PartialImageAsked,
    ProgressAsked,
    ServerLost,
)
from volsplat.client.coordinator.events.instructions import EndFrame, PublishImage, Send
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.message import Message


class World:
    """Servers that keep to the protocol, each at its own pace, and a person who asks for frames."""

    def __init__(self, random: Random) -> None:
        self.random = random
        self.coordinator = drawing_big()
        request = running(self.coordinator)
        self.to_do: dict[int, deque[Message]] = {n: deque([request]) for n in (FIRST, SECOND, *THREE)}
        self.at: dict[int, messages.RenderFrame] = {}  # what each splat server draws
        self.silent: set[int] = set()
        self.links_end = self.random.choice([0.0, 0.3])  # how often one has ended when a worker has done its part
        self.newest = 1
        self.answers: dict[int, list[PublishImage | EndFrame]] = {1: []}
        for worker in (FIRST, SECOND):
            self.happens(said(worker, messages.ConnectedToSplatServers(THREE)))

    def happens(self, event: Event) -> None:
        for instruction in self.coordinator.handle(event):
            match instruction:
                case Send(server, messages.EndSession()):
                    self.to_do.pop(server)
                    self.at.pop(server, None)
                case Send(server, message) if server in self.to_do:
                    self.to_do[server].append(message)
                case PublishImage(frame=frame) | EndFrame(frame=frame):
                    self.answers[frame].append(instruction)

    def ask(self) -> None:
        self.newest += 1
        self.answers[self.newest] = []
        self.happens(FrameAsked(self.newest, BIG, Step.F, self.random.random() < 0.5))

    def lose(self, server: int) -> None:
        del self.to_do[server]
        self.at.pop(server, None)
        self.happens(ServerLost(server, GONE))

    def works(self, server: int) -> None:
        """A server does the next of what it was asked for."""
        match self.to_do[server].popleft():
            case messages.RenderFrame() as request if server in THREE:
                self.at[server] = request
            case messages.RenderFrame() as request:
                self.happens(mapped(request, server, *self.unreached(request)))
            case messages.AbortFrame(frame=frame):
                self.at.pop(server, None)
                self.happens(said(server, messages.FrameAborted(frame)))
            case messages.ReadImage(frame=frame):
                if server in self.at and self.at[server].frame == frame:
                    self.happens(image(self.at[server], server, False))
            case messages.ReadProgress(frame=frame):
                if server in self.at and self.at[server].frame == frame:
                    self.happens(said(server, messages.FrameProgress(frame, self.random.random())))
            case messages.ConnectToSplatServers(routes=routes):
                self.happens(said(server, messages.ConnectedToSplatServers([route.server for route in routes])))

    def unreached(self, request: messages.RenderFrame) -> list[int]:
        """A splat server of the frame to which a worker's link has ended, unless it is the last one."""
        there = [splat for splat in rectangles(request) if splat in self.to_do]
        ends = len(there) > 1 and self.random.random() < self.links_end
        return [self.random.choice(there)] if ends else []

    def finishes(self, server: int) -> None:
        request = self.at.pop(server, None)
        if request is not None:
            self.happens(finished(request, server))
            self.happens(image(request, server, True))

    def moves(self) -> None:
        """Anything that may happen next."""
        speaking = [server for server in self.to_do if server not in self.silent]
        busy = [server for server in speaking if self.to_do[server]]
        drawing = [server for server in speaking if server in self.at and not self.to_do[server]]
        splat_servers = [server for server in self.to_do if server in THREE]
        move = self.random.random()
        if move < 0.05 and len(splat_servers) > 1:
            self.lose(self.random.choice(splat_servers))
        elif move < 0.1:
            self.silent.add(self.random.choice(splat_servers))
        elif move < 0.2:
            self.ask()
        elif move < 0.25:
            self.happens(AbortAsked(self.newest))
        elif move < 0.4:
            self.happens(PartialImageAsked(self.newest))
        elif move < 0.45:
            self.happens(ProgressAsked(self.newest))
        elif move < 0.65 and drawing:
            self.finishes(self.random.choice(drawing))
        elif busy:
            self.works(self.random.choice(busy))

    def rests(self) -> None:
        """Whoever is silent is given up, unless it is the last one; then all that was asked for is done."""
        for server in sorted(self.silent & self.to_do.keys()):
            if sum(number in THREE for number in self.to_do) > 1:
                self.lose(server)
        self.silent.clear()
        self.links_end = 0.0
        while any(self.to_do.values()) or self.at:
            for server in list(self.to_do):
                while self.to_do[server]:
                    self.works(server)
                self.finishes(server)


@given(st.randoms(use_true_random=False), st.integers(1, 80))
def test_whatever_servers_do_every_frame_ends_and_the_next_one_is_whole(random: Random, moves: int) -> None:
    world = World(random)
    for _ in range(moves):
        world.moves()
    world.rests()
    for answers in world.answers.values():
        *partial, last = answers
        assert isinstance(last, EndFrame) or last.complete, "it is still waited for"
        assert all(isinstance(one, PublishImage) and not one.complete for one in partial)
    world.ask()
    world.rests()
    last = world.answers[world.newest][-1]
    assert isinstance(last, PublishImage) and last.complete
    check_whole(last)
