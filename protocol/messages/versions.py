"""Which versions of the protocol this program speaks, and how two programs agree on one."""

from typing import NamedTuple


class VersionRange(NamedTuple):
    """All versions from `oldest` to `newest`, both included."""

    oldest: int
    newest: int

    def __str__(self) -> str:
        if self.oldest == self.newest:
            return f"version {self.newest}"
        return f"versions {self.oldest} to {self.newest}"

    def shared(self, other: "VersionRange") -> int | None:
        """The newest version that both ranges hold, None where there is none."""
        newest = min(self.newest, other.newest)
        return newest if newest >= max(self.oldest, other.oldest) else None


SPOKEN = VersionRange(oldest=6, newest=6)
