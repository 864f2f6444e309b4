"""The levels of a prepared volume: which of them a scene needs, and which the map/shade servers have read."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

from volsplat.client.coordinator.events.instructions import Instruction, ReportProgress, Send
from volsplat.client.coordinator.holding.base_level import LevelChoice
from volsplat.client.coordinator.holding.packing import Packing
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume_identity import VolumeIdentity
from volsplat.protocol.messages import messages
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.levels import levels_drawn, resolution_of
from volsplat.protocol.text.errors import BadInput


class StoredLevels:
    """Levels are read when the first step needs them, the coarsest first."""

    def __init__(self, name: str, stored_by: Quantisation, choice: LevelChoice) -> None:
        self._name = name
        self.grids = choice.grids
        self._stored_by = stored_by
        self._choice = choice
        self._held: Sequence[int] = ()  # or being read
        self._ready: Sequence[int] = ()  # of them, those that are not still being read
        self._before: Sequence[int] = ()  # what was ready when the last was opened

    def wanted(self, scene: Scene, step: Step, quantisation: Quantisation, current: Packing | None) -> Packing:
        """What a step is drawn from. `current` is what a person who moves through scenes has been drawn.

        Raises BadInput where the volume was prepared by other rules.
        """
        _check_rules(self._name, quantisation, self._stored_by)
        base = self._choice.base_level(scene, current.base_level if current is not None else None)
        drawn = resolution_of(step, self.grids, base.level, scene.refine.striding)
        return Packing(quantisation, base.level, drawn.level, base.why)

    def open(
        self, wanted: Packing, assignment: int, path: str, identity: VolumeIdentity, servers: Iterable[int]
    ) -> tuple[Packing, list[Instruction]]:
        """Have the servers read what is wanted, and what they will hold then.

        Levels that are ready stay, as far as a step of the new base level draws them.
        """
        drawn = levels_drawn(self.grids, wanted.base_level)
        self._before = self._ready
        self._ready = [level for level in drawn if level in self._ready]
        self._held = [level for level in drawn if level >= wanted.level or level in self._ready]
        last = len(self.grids) - 1
        told: list[Instruction] = [ReportProgress(f"reading level {level} of {last}") for level in self._reading()[:1]]
        for server in servers:
            held = self._choice.holdings(server, self._held)
            opened = messages.OpenPackets(assignment=assignment, path=path, levels=held, identity=identity)
            told.append(Send(server, opened))
        return replace(wanted, level=self._held[0]), told

    @property
    def packets_a_voxel(self) -> float:
        """Of the volume, over all levels that are held."""
        return sum(self.grids[level].box.voxels for level in self._held) / self.grids[0].box.voxels

    def refused(self, kept: bool) -> None:
        """What was opened last cannot be had: the servers hold what they held before, or nothing."""
        self._held = self._ready = self._before if kept else ()

    def opened(self) -> None:
        """All servers have read what they were to hold."""
        self._ready = self._held

    def give_way(self, wanted: Packing) -> bool:
        """Whether all that is wanted is ready, and what is being read is finer."""
        return wanted.level in self._ready and min(self._reading(), default=wanted.level) < wanted.level

    def _reading(self) -> list[int]:
        return [level for level in self._held if level not in self._ready]


def _check_rules(name: str, wanted: Quantisation, stored: Quantisation) -> None:
    if wanted.window != stored.window:
        low, high = (repr(end).removesuffix(".0") for end in wanted.window)  # the very numbers
        raise BadInput(
            f"{name} was prepared with the window {stored.window[0]:g} to {stored.window[1]:g}; "
            f"for another one prepare it again with --window {low},{high}"
        )
    if wanted.directions != stored.directions:
        raise BadInput(
            f"{name} was prepared with {stored.directions} directions; set them in the scene, "
            f"or prepare it again with --directions {wanted.directions}"
        )
