"""What a viewport and the client's process say to each other, as JSON (docs/page.md)."""

from __future__ import annotations

import json
from typing import Any

import msgspec

from volsplat.client.image.empty_image import why_empty
from volsplat.client.scene.view_sides import sides
from volsplat.client.ui.viewing.pacing import StepPacing
from volsplat.client.ui.viewing.picture import Picture
from volsplat.client.ui.viewing.scene_model import SceneState
from volsplat.protocol.description.scene import Scene, Step, View
from volsplat.protocol.description.volume import Geometry, Index, VolumeDescription
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.upright import Up, upright
from volsplat.protocol.rules.refinement import finer
from volsplat.protocol.rules.resolved_view import resolved_bounds, resolved_center, resolved_zoom

HEADER_LENGTH_BYTES = 4  # little-endian, before a picture's header


class Said(msgspec.Struct, tag_field="type", forbid_unknown_fields=True):
    """Base of what the page says."""


class Size(Said, tag="size"):
    width: int
    height: int


class ViewTurned(Said, tag="view"):
    rotation: tuple[float, float, float, float]
    zoom: float
    center: tuple[float, float, float]
    settled: bool
    event: int


class BoundsMoved(Said, tag="bounds"):
    low: Index
    high: Index
    settled: bool
    event: int


class ProbeAsked(Said, tag="probe"):
    x: float
    y: float


class CenterAsked(Said, tag="center"):
    x: float
    y: float


class UndoAsked(Said, tag="undo"):
    pass


class RedoAsked(Said, tag="redo"):
    pass


class PictureShown(Said, tag="shown"):
    number: int


PageMessage = Size | ViewTurned | BoundsMoved | ProbeAsked | CenterAsked | UndoAsked | RedoAsked | PictureShown
_decoder = msgspec.json.Decoder(PageMessage)


def page_message(text: str) -> PageMessage:
    """What the page said. Raises msgspec.ValidationError or DecodeError."""
    message: PageMessage = _decoder.decode(text)
    return message


def volume_message(description: VolumeDescription, up: Up) -> dict[str, Any]:
    """The volume as it stands with this physical axis up."""
    geometry = description.geometry
    return {
        "type": "volume",
        "name": description.name,
        "dims": geometry.dims,
        "index_to_upright": matrices.product(upright(up), geometry.index_to_physical),
        "reference_spacing": geometry.reference_spacing,
        "unit": description.unit,
        "sides": {name: side.mark for name, side in sides(description, up).items()},
        "density_name": description.density_name,
        "strength_name": description.strength_name,
        "value_unit": description.value_unit,
        "axes": msgspec.to_builtins(description.axes),
    }


def scene_message(state: SceneState, geometry: Geometry, fit: View | None) -> dict[str, Any]:
    """`fit` is the view at which what is visible fits; None where it is the one that was told before."""
    scene = state.scene
    bounds = resolved_bounds(scene, geometry)
    return {
        "type": "scene",
        "revision": state.revision,
        "by": state.by,
        "settled": state.settled,
        "view": _view(scene, geometry),
        "fit": {"zoom": fit.zoom, "center": fit.center} if fit is not None else None,
        "bounds": {"low": bounds.low, "high": bounds.high},
        "edges": scene.image.edges,
        "width": scene.image.width,
        "height": scene.image.height,
    }


def trouble_message(text: str, lasting: bool = False) -> dict[str, Any]:
    return {"type": "trouble", "text": text, "lasting": lasting}


def picture_message(picture: Picture, tab: str, geometry: Geometry, pacing: StepPacing) -> bytes:
    """A picture for one tab: its header's length, its header, its image."""
    following = _following(picture)
    header = {
        "number": picture.number,
        "revision": picture.state.revision,
        "event": picture.state.events.get(tab, 0),
        "step": picture.step,
        "complete": picture.complete,
        "last": picture.last,
        "seconds": picture.outcome.wall_seconds if picture.outcome else None,
        "next": {"step": following, "expected": pacing.expected(following)} if following else None,
        "width": picture.published.width,
        "height": picture.published.height,
        "view": _view(picture.state.scene, geometry),
        "notice": why_empty(picture.published.pixels, picture.state.scene) if picture.last else "",
        "missing": picture.outcome.servers.missing if picture.outcome else [],
    }
    encoded = json.dumps(header).encode()
    return len(encoded).to_bytes(HEADER_LENGTH_BYTES, "little") + encoded + picture.data


def _following(picture: Picture) -> Step | None:
    """The step that is drawn while this picture is looked at."""
    if not picture.complete:
        return picture.step
    return finer(picture.step) if picture.state.settled else None


def _view(scene: Scene, geometry: Geometry) -> dict[str, Any]:
    return {
        "rotation": scene.view.rotation,
        "zoom": resolved_zoom(scene, geometry),
        "center": resolved_center(scene, geometry),
    }
