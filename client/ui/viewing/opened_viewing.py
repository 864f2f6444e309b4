"""Puts a session, its scene and its drawing loop together."""

from __future__ import annotations

from volsplat.client.session.session import Session
from volsplat.client.ui.viewing.drawing_loop import DrawingLoop
from volsplat.client.ui.viewing.image_size import ImageSize
from volsplat.client.ui.viewing.picture import Picture
from volsplat.client.ui.viewing.scene_model import SceneModel
from volsplat.client.ui.viewing.trouble import BY_HAND, Trouble, end_of_session
from volsplat.client.ui.viewing.viewing import Feed, Troubles, Viewing
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.text.errors import VolsplatError


def opened_viewing(session: Session, scene: Scene, cure: str = BY_HAND) -> Viewing:
    """Everything that a page needs; the drawing loop is not started yet. `cure` is that of a session that has ended."""
    pictures: Feed[Picture] = Feed()
    troubles = Troubles()
    model = SceneModel(scene, session.volume.fitted_to_turn)

    def tell(error: VolsplatError) -> None:
        if loop.session is viewing.session:  # else another one is being opened in its place
            failure = viewing.session.failure
            troubles.tell(Trouble(str(error)) if failure is None else end_of_session(failure, cure))

    size = ImageSize()
    loop = DrawingLoop(session, model, pictures.tell, tell, is_watched=lambda: size.has_windows)
    viewing = Viewing(session, model, loop, session.volume, session.default_scene(), pictures, troubles, cure, size)
    return viewing
