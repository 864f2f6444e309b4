"""What a saved image says of the volume."""

from pathlib import Path

import msgspec
import torch

from support.scenes.arbitrary import plain_scene
from volsplat.client.image.image_file import read_properties, read_scene, write_image
from volsplat.client.image.image_properties import PIXEL_SIZE, VOLUME, image_properties
from volsplat.protocol.description.scene import View
from volsplat.protocol.description.volume import Geometry, VolumeDescription

GEOMETRY = Geometry(dims=(8, 9, 10), index_to_physical=((0.5, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, 4.0)))
DESCRIPTION = VolumeDescription(
    name="head", format="NRRD", geometry=GEOMETRY, scalar_type="int16", unit="mm", value_unit="HU", anatomical=True
)
SCENE = plain_scene(view=View(zoom=4.0))


def test_an_image_tells_what_it_shows_and_how_large_its_pixels_are(tmp_path: Path) -> None:
    for kind in ("png", "exr", "jpg"):
        path = tmp_path / f"image.{kind}"
        write_image(path, torch.zeros(8, 8, 4), SCENE, image_properties(DESCRIPTION, SCENE))
        stored = read_properties(path)
        assert msgspec.json.decode(stored[VOLUME], type=VolumeDescription) == DESCRIPTION
        assert stored[PIXEL_SIZE] == "0.25 mm"  # reference spacing 1 mm, 4 pixels each
        assert read_scene(path) == SCENE


def test_without_a_unit_pixels_are_told_in_voxels() -> None:
    nowhere = msgspec.structs.replace(DESCRIPTION, unit="")
    assert image_properties(nowhere, SCENE)[PIXEL_SIZE] == "0.25 voxels"
