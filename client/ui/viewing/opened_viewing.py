"""Puts a session, its scene and its drawing loop together."""

from __future__ import annotations

from volsplat.client.session.session import Session
from volsplat.client.ui.viewing.drawing_loop import DrawingLoop
from volsplat.client.ui.viewing.picture import Picture
from volsplat.client.ui.viewing.scene_model import SceneModel
from volsplat.client.ui.viewing.trouble import Trouble, trouble_of
from volsplat.client.ui.viewing.viewing import Feed, Viewing
from volsplat.protocol.description.scene import Scene


def opened_viewing(session: Session, scene: Scene) -> Viewing:
    """Everything that a page needs; the drawing loop is not started yet."""
    pictures: Feed[Picture] = Feed()
    troubles: Feed[Trouble] = Feed()
    model = SceneModel(scene, session.volume.fitted)
    loop = DrawingLoop(session, model, pictures.tell, lambda error: troubles.tell(trouble_of(error)))
    return Viewing(session, model, loop, session.volume, session.default_scene(), pictures, troubles)
