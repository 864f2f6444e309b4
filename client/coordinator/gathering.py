"""The servers that a volume waits for before it is begun: as many as are asked for, or those that there are."""

from collections.abc import Sequence
from dataclasses import replace

from volsplat.client.coordinator.events.events import VolumeAsked
from volsplat.client.coordinator.events.instructions import Instruction, ReportLoss, ReportProgress
from volsplat.client.coordinator.holding.base_level import budgets
from volsplat.client.coordinator.holding.phase import Phase
from volsplat.client.coordinator.holding.volume_holding import VolumeHolding
from volsplat.client.coordinator.servers import Servers
from volsplat.protocol.messages.handlers import takes
from volsplat.protocol.messages.roles import Role


class Gathering:
    """Goes on until the volume is begun, and anew where all are lost that had begun."""

    def __init__(self, servers: Servers, holding: VolumeHolding) -> None:
        self._servers = servers
        self._holding = holding
        self._asked: VolumeAsked | None = None
        self._few_suffice = False  # those that are missing are not waited for

    @takes(VolumeAsked)
    def _ask(self, event: VolumeAsked) -> list[Instruction]:
        self._asked = event
        return self.begin()

    def begin(self) -> list[Instruction]:
        """Have the volume described, once it is asked for and enough servers are there."""
        asked, servers = self._asked, self._servers
        if self._holding.phase != Phase.GATHERING or asked is None:
            return []
        workers, splat_servers = servers.ready(Role.MAPSHADE_SERVER), servers.ready(Role.SPLAT_SERVER)
        enough = len(workers) >= asked.workers and len(splat_servers) >= asked.splat_servers
        if not (enough or (self._few_suffice and workers and splat_servers)):
            missing = (
                f"{len(workers)} of {asked.workers} map/shade servers, "
                f"{len(splat_servers)} of {asked.splat_servers} splat server{'s' if asked.splat_servers > 1 else ''}"
            )
            return [ReportProgress(f"waiting for servers: {missing} joined")]
        servers.workers, servers.splat_servers = workers[: asked.workers], splat_servers[: asked.splat_servers]
        return self._holding.begin(asked.path, self.memory(servers.workers), asked.held)

    def begin_without(self, cause: str) -> list[Instruction]:
        """Those that are missing, by this cause, are waited for no more."""
        if self._few_suffice:
            return []
        self._few_suffice = True
        return [ReportLoss(f"{cause}; the others draw without"), *self.begin()]

    def begin_anew(self) -> list[Instruction]:
        """With the first map/shade server that there is, or that joins: all that had begun are lost."""
        if self._asked is not None:
            self._asked = replace(self._asked, workers=1)
        return self.begin()

    def memory(self, workers: Sequence[int]) -> dict[int, int]:
        """What of a prepared volume each of these may hold."""
        servers, asked = self._servers, self._asked
        if asked is not None and asked.memory is not None:
            return dict.fromkeys(workers, asked.memory)
        left = {worker: servers.states[worker].memory_bytes for worker in workers}
        return budgets(left, {worker: servers.joined[worker].host for worker in left})
