"""What pushes along the axis of densities have made of tables, for all tabs: another push begins where they did."""

from __future__ import annotations

from volsplat.client.ui.viewing.scene_model import MOST_UNDONE
from volsplat.protocol.description.shading_tables import Tables

Pushed = tuple[Tables, tuple[str, ...]]  # what a push made, and the tables of it that were moved
Begun = tuple[Tables, float]  # the tables before the first push, and by which share of the axis all have moved them


class KnownPushes:
    """Of those that were let go of the newest, and the one under way: its hand may be gone before it lets go."""

    def __init__(self) -> None:
        self._ended: dict[Pushed, Begun] = {}
        self._under_way: tuple[Pushed, Begun] | None = None

    def begun(self, pushed: Pushed) -> Begun:
        """What made these tables; themselves if no push has."""
        if self._under_way is not None and self._under_way[0] == pushed:
            self.note(*self._under_way, settled=True)
        return self._ended.get(pushed, (pushed[0], 0.0))

    def note(self, pushed: Pushed, begun: Begun, settled: bool) -> None:
        if not settled:
            self._under_way = (pushed, begun)
            return
        self._ended[pushed] = begun
        if len(self._ended) > MOST_UNDONE:
            del self._ended[next(iter(self._ended))]
