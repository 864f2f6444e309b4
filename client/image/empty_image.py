"""What explains an image that shows nothing: it may be meant, or a table or a view may have gone wrong."""

from __future__ import annotations

from typing import TYPE_CHECKING

from volsplat.protocol.description.scene import Scene

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def why_empty(image: NDArray[np.float32], scene: Scene) -> str:
    """One line for the person; "" if something is visible. `image` is (H, W, 4), associated, without background."""
    if image[..., 3].any():
        return ""
    if scene.plane.patches:
        return (
            "nothing is visible: no voxel within the bounds and the image lies in a patch of the 2-D table; move or "
            "widen the patches, raise their opacity, or reset the view and the bounds"
        )
    if scene.tables.opac.greatest == 0:
        return "nothing is visible: the opacity table is 0 everywhere; raise it"
    if scene.shading.modulation and scene.tables.modu.greatest == 0:
        return "nothing is visible: the modulation table is 0 everywhere; raise it, or switch modulation off"
    return (
        "nothing is visible: the tables leave all of the volume transparent that is within the bounds and the image; "
        "raise the opacity, set the density window to the range of the values (of a mask 0 to 1), or reset the view "
        "and the bounds"
    )
