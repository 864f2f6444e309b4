"""What a viewport gets of slices, from the real command with real servers."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from PIL import Image as PillowImage

from support.pages.viewed import Shown, Viewport, viewed
from volsplat.client.session.single import SingleProcess
from volsplat.client.slices.slice_picture import slice_picture

SIDE = 48


def next_slice(viewport: Viewport) -> Shown:
    while True:
        heard = viewport.hears()
        if isinstance(heard, Shown) and "slice" in heard.header:
            viewport.says("slice_shown")
            return heard
        if isinstance(heard, Shown):
            viewport.says("shown", number=heard.header["number"])


def pixels(shown: Shown) -> np.ndarray:
    return np.asarray(PillowImage.open(io.BytesIO(shown.data)).convert("RGBA"))


def test_the_three_slices_come_one_by_one_and_again_only_if_they_change_or_a_server_is_lost(volume: Path) -> None:
    with viewed(volume.parent, volume, "--workers", "2") as view, view.viewport("a") as viewport:
        viewport.says("size", width=SIDE, height=SIDE)
        viewport.last_picture(width=SIDE)
        viewport.says("slices", at=[12, 16, 99], coloured=True, longest=64)
        assert "no voxel (12, 16, 99)" in viewport.message("trouble")["text"]
        viewport.says("slices", at=[12, 16, 14], coloured=True, longest=64)
        got = {shown.header["slice"]: shown for shown in (next_slice(viewport) for _ in range(3))}
        assert {axis: shown.header["index"] for axis, shown in got.items()} == {0: 12, 1: 16, 2: 14}
        with SingleProcess(volume) as single:
            scene = single.volume.default_scene()
            for axis, shown in got.items():
                alone = single.read_slice(scene, "ijk"[axis], shown.header["index"])
                np.testing.assert_array_equal(pixels(shown), slice_picture(alone, coloured=True))
            voxel = single.read_slice(scene, "k", 14).voxel((3, 4, 14))
        viewport.says("voxel", index=[3, 4, 14])
        told = viewport.message("voxel")
        assert voxel is not None and told["found"]["density"] == voxel.density
        viewport.says("voxel", index=[3, 4, 5])  # in none of them
        assert viewport.message("voxel")["found"] is None

        viewport.says("slices", at=[12, 16, 15], coloured=True, longest=64)
        assert next_slice(viewport).header["slice"] == 2
        view.mapshade_servers()[0].kill()
        viewport.says("slices", at=[13, 16, 15], coloured=True, longest=64)
        moved = next_slice(viewport)
        assert (moved.header["slice"], moved.header["index"], moved.header["missing"]) == (0, 13, False)
        viewport.says("slices", at=None, coloured=True, longest=64)
        viewport.says("slices", at=[13, 16, 15], coloured=False, longest=16)
        grey = [next_slice(viewport) for _ in range(3)]
        assert sorted(max(pixels(shown).shape[:2]) for shown in grey) == [14, 16, 16]
        assert grey[0].header["step"] == [2, 2]
