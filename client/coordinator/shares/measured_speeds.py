"""How fast each server works, by what its frames took."""

from collections.abc import Iterable

TELLING_SECONDS = 0.002  # of work: a server's speed is not known from less
NEWEST_WEIGHT = 0.5  # of the speed that was measured last


class MeasuredSpeeds:
    """Work a second, in any unit of work."""

    def __init__(self) -> None:
        self._speeds: dict[int, float] = {}  # by server

    def note(self, server: int, work: float, seconds: float) -> None:
        """A server took so long for so much, unless that tells nothing."""
        if seconds >= TELLING_SECONDS and work:
            speed, before = work / seconds, self._speeds.get(server)
            self._speeds[server] = speed if before is None else NEWEST_WEIGHT * speed + (1 - NEWEST_WEIGHT) * before

    def of(self, servers: Iterable[int]) -> dict[int, float]:
        """Of each of these; as those of them that are known have it on average, if it is not known."""
        wanted = list(servers)
        known = [self._speeds[server] for server in wanted if server in self._speeds]
        usual = sum(known) / len(known) if known else 1.0
        return {server: self._speeds.get(server, usual) for server in wanted}
