"""Has parts of the volume change hands between frames: what was lost is taken over, newcomers get a part."""

from volsplat.client.coordinator.data_routes import DataRoutes
from volsplat.client.coordinator.events.instructions import Instruction, ReportLoss, ReportProgress
from volsplat.client.coordinator.gathering import Gathering
from volsplat.client.coordinator.holding.phase import Phase
from volsplat.client.coordinator.holding.volume_holding import VolumeHolding
from volsplat.client.coordinator.reading_ahead import READING_WHAT_WAS_LOST, ReadingAhead
from volsplat.client.coordinator.servers import Servers
from volsplat.client.coordinator.shares.heirs import Boxes, shared_anew, taken_over
from volsplat.client.coordinator.work_shares import WorkShares

_STAY = "the sub-cubes stay where they are"
_ANEW = "the volume is read anew for the next image"
_NO_HEIR = "nobody takes over what was lost"
TRIED_AGAIN_AFTER = 8  # frames that are asked for, and then after twice as many each time,
_SELDOM = 1024  # up to so many


class SharingOut:
    """Among the servers that are there, so that together they hold the volume, and none works much longer."""

    def __init__(
        self, servers: Servers, holding: VolumeHolding, gathering: Gathering, routes: DataRoutes, work: WorkShares
    ) -> None:
        self._servers = servers
        self._holding = holding
        self._gathering = gathering
        self._routes = routes
        self._work = work
        self.ahead = ReadingAhead(holding)
        self._frames = 0  # that were asked for since nobody took over what was lost
        self._patience = TRIED_AGAIN_AFTER
        self._told = ""  # why nobody did

    @property
    def heals(self) -> bool:
        """Whether others will hold what is missing: until then nobody knows what is seen first along a line."""
        return bool(self._servers.missing) and self._holding.assignments.may_move

    @property
    def all_is_held(self) -> bool:
        """By servers that are there, or missing and known to be."""
        held = [*self._servers.missing, *(box for boxes in self._holding.boxes.values() for box in boxes)]
        return sum(box.voxels for box in held) == self._holding.description.geometry.box.voxels

    def frame_asked(self) -> None:
        """What nobody could take over is tried again, ever more seldom: a file comes back, and memory is freed."""
        if self._holding.assignments.may_move or not self._servers.missing:
            return
        self._frames += 1
        if self._frames >= self._patience:
            self._frames, self._patience = 0, min(2 * self._patience, _SELDOM)
            self._holding.assignments.may_move = True

    def share(self, *, at_once: bool, may_be_whole: bool) -> list[Instruction]:
        """Have what was lost taken over, newcomers get a part, or sub-cubes change hands where that pays.

        What was lost is read beside frames first, unless it is to be taken over `at_once`, and changes hands once the
        next frame `may_be_whole`.
        """
        holding, newcomers = self._holding, self._servers.idle()
        if holding.volume is None:
            return []
        description = holding.description
        where = description.geometry, description.chunk
        if missing := self._servers.missing:
            if not ((holding.boxes or newcomers) and holding.assignments.may_move):
                return []
            heirs = taken_over(missing, holding.boxes, newcomers, *where)
            return self._make_good(heirs, at_once=at_once, may_be_whole=may_be_whole)
        self._frames, self._patience, self._told = 0, TRIED_AGAIN_AFTER, ""
        if newcomers and holding.may_change and (anew := shared_anew(holding.boxes, newcomers, *where)):
            return [ReportProgress("sharing out the volume among more servers"), *self._hold(anew)]
        return self._work.move()

    def _make_good(self, boxes: Boxes, *, at_once: bool, may_be_whole: bool) -> list[Instruction]:
        """Have what is missing held as part of these boxes."""
        asked = [] if at_once else self.ahead.towards(boxes)
        if asked:
            self._servers.note_missing("")
        if asked or (self.ahead.goes_on(boxes) and not at_once) or not may_be_whole:
            return asked
        self._servers.hand_over()
        told = [] if self.ahead.ends(boxes) else [ReportProgress(READING_WHAT_WAS_LOST)]
        return [*told, *self._hold(boxes)]

    def _hold(self, boxes: Boxes) -> list[Instruction]:
        """Have these boxes held, by servers that may be new."""
        new = [server for server in boxes if server not in self._holding.boxes]
        self._servers.workers = [*self._servers.workers, *new]
        self._work.forget()
        told = [*self._routes.invite(boxes), *self._routes.connect(new)]
        return [*told, *self._holding.share(boxes, self._gathering.memory(new))]

    def ahead_refused(self, server: int, why: str) -> list[Instruction]:
        """A server does not read ahead what it was to get."""
        if not self.ahead.refused(server):
            return []
        self.ahead.ends()
        self._holding.assignments.may_move = False
        return self._left_missing(why)

    def _left_missing(self, why: str) -> list[Instruction]:
        """Told once for each cause, however often it is tried again."""
        self._servers.note_missing(why)
        before, self._told = self._told, why
        return [ReportLoss(f"{why}; {_NO_HEIR}")] if why != before else []

    def tell_refused(self) -> list[Instruction]:
        """Once all have answered: what becomes of an assignment that somebody has refused, and why."""
        holding, assignments = self._holding, self._holding.assignments
        if not holding.settled or not (why := assignments.take_refusal()):
            return []
        if not self.all_is_held:
            self._servers.take_back()
            if self._servers.idle():  # who has joined since may have what it takes
                assignments.may_move = True
                return []
            return self._left_missing(why)
        if not assignments.moving:  # whoever waits for it was told
            return []
        return [ReportProgress(f"{why}; {_ANEW if holding.phase is Phase.EMPTY else _STAY}")]

    def validate_state(self) -> None:
        """Raises AssertionError if an invariant is broken."""
        self.ahead.validate_state()
        if self._holding.volume is not None:
            assert self.all_is_held or not self._holding.settled, "the sub-cubes do not make up the volume"
