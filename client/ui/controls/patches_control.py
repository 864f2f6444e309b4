"""The scene's 2-D table on the page, with the histogram behind it that the servers count."""

from __future__ import annotations

import asyncio
import logging
from typing import TYPE_CHECKING

from nicegui import background_tasks, ui

from volsplat.client.histogram.plane_counts import PlaneCounts
from volsplat.client.ui.controls.controls import SceneEditor
from volsplat.client.ui.controls.patch_editor import PatchEditor
from volsplat.client.ui.doors.static_files import STATIC
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.client.volume.field_axis import field_axis
from volsplat.protocol.description.patches import Patches
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.scene_keys import KEYS
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES, Field
from volsplat.protocol.text.errors import BadInput, VolsplatError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

log = logging.getLogger(__name__)

STYLE = STATIC / "tables" / "patch_editor.css"
SIDE = 128  # of the drawn histogram: two bytes of a field are one of its places
LEVELS = 255


def patches_control(editor: SceneEditor, viewing: Viewing) -> None:
    """Build it where the page is being built."""
    ui.add_css(STYLE)
    PatchesControl(editor, viewing)


class PatchesControl:
    """The patches of one tab. What is counted is asked for once the drawing is in sight, and for each window anew."""

    def __init__(self, editor: SceneEditor, viewing: Viewing) -> None:
        self._editor = editor
        self._viewing = viewing
        self._seen = False
        self._counted: object = None  # the window of what is shown
        self._counting = False
        self._patches = PatchEditor(self._changed, self._on_seen)
        editor.follow(self._follow)

    def _changed(self, patches: Patches, settled: bool) -> None:
        self._editor.change(lambda scene: KEYS["plane.patches"].put(scene, patches), settled=settled)

    def _on_seen(self) -> None:
        self._seen, self._counted = True, None  # a page that comes back has forgotten
        self._count()

    def _follow(self, scene: Scene) -> None:
        volume = self._viewing.volume
        self._patches.show(scene.plane.patches)
        try:
            axes = [field_axis(volume, field, scene.quantise) for field in (Field.DENSITY, Field.STRENGTH)]
        except BadInput:  # a window without a scale, which its field tells of
            return
        self._patches.show_axes(*axes)
        self._count()

    def _count(self) -> None:
        if self._seen and not self._counting and self._counted != self._editor.scene.quantise:
            self._counting = True
            background_tasks.create(self._ask())

    async def _ask(self) -> None:
        """Until what is shown is of the scene's window."""
        try:
            while self._counted != (wanted := self._editor.scene).quantise:
                counts = await asyncio.to_thread(self._viewing.session.plane_counts, wanted)
                self._counted = wanted.quantise
                self._patches.show_counts(drawn(counts))
        except VolsplatError as error:  # whoever draws the picture tells it
            log.info("no 2-D histogram: %s", error)
        finally:
            self._counting = False


def drawn(counts: PlaneCounts) -> NDArray[np.uint8]:
    """Logarithmic levels of places, (strengths, densities): 0 where there is no voxel, the most at the fullest."""
    import numpy as np

    by = TABLE_ENTRIES // SIDE
    sums = np.frombuffer(counts.counts, np.uint64).astype(np.float64).reshape(SIDE, by, SIDE, by).sum(axis=(1, 3))
    most = np.log1p(sums.max())
    shown: NDArray[np.uint8] = np.ceil(LEVELS * np.log1p(sums) / (most or 1.0)).astype(np.uint8)
    return shown
