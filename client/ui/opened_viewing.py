"""Puts a session, its scene and its drawing loop together."""

from __future__ import annotations

from volsplat.client.session import Session
from volsplat.client.ui.drawing_loop import DrawingLoop
from volsplat.client.ui.picture import Picture
from volsplat.client.ui.scene_model import SceneModel
from volsplat.client.ui.viewing import Feed, Viewing
from volsplat.protocol.errors import VolsplatError
from volsplat.protocol.scene import Scene


def opened_viewing(session: Session, scene: Scene) -> Viewing:
    """Everything that a page needs; the drawing loop is not started yet."""
    pictures: Feed[Picture] = Feed()
    troubles: Feed[VolsplatError] = Feed()
    model = SceneModel(scene, session.volume.fitted)
    loop = DrawingLoop(session, model, pictures.tell, troubles.tell)
    return Viewing(session, model, loop, session.volume, session.default_scene(), pictures, troubles)
