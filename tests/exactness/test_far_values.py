"""A few voxels whose values lie far from all others: hot ones, or a fill value that nobody declared."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from support.files.prepared import Told
from volsplat.client import Session
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.session.single import SingleProcess
from volsplat.mapshade_server.prepare import Options, prepare
from volsplat.protocol.description.block_extremes import BlockExtremes
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.rules.index_rules import HISTOGRAM_BINS, Survey, narrowed

SIDE = 40
FAR = [1e3, -1e5, 1e7, -1e16, 1e30]


def noisy_ball() -> NDArray[np.float32]:
    """Values of about 0 to 1."""
    places = np.linalg.norm(np.indices((SIDE,) * 3) - (SIDE - 1) / 2, axis=0)
    noise = np.random.default_rng(1).normal(scale=0.01, size=(SIDE,) * 3)
    values: NDArray[np.float32] = (np.clip(1.2 - 3 * places / SIDE, 0.0, 1.0) + noise).astype(np.float32)
    return values


def written(folder: Path, far: float | None) -> Path:
    values = noisy_ball()
    if far is not None:
        values[5, 6, 7] = far
    write_volume(folder / "ball.nrrd", torch.from_numpy(values), Geometry((SIDE, SIDE, SIDE)))
    return folder / "ball.nrrd"


def sized(scene: Scene) -> Scene:
    return scene.with_(size=96)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> SingleProcess:
    return SingleProcess(written(tmp_path_factory.mktemp("plain"), None))


@pytest.mark.parametrize("far", FAR)
def test_one_voxel_makes_no_other_picture_of_the_rest(far: float, plain: SingleProcess, tmp_path: Path) -> None:
    with SingleProcess(written(tmp_path, far)) as single:
        window, expected = single.volume.automatic_window, plain.volume.automatic_window
        assert window == pytest.approx(expected, abs=0.02)
        assert single.volume.strength_scale == pytest.approx(plain.volume.strength_scale, rel=0.05)
        drawn, whole = (
            one.finish(sized(one.volume.default_scene())).published.pixels[..., 3].sum() for one in (single, plain)
        )
        assert drawn == pytest.approx(whole, rel=0.02)
        assert f"as far off as {np.float32(far):.7g}" in single.volume.notes()[0]


def test_servers_and_a_store_know_the_same(tmp_path: Path) -> None:
    path = written(tmp_path, 1e5)
    prepare(str(path), tmp_path / "ball.zarr", Options(), Told())
    with SingleProcess(path) as single, SingleProcess(tmp_path / "ball.zarr") as stored:
        with Session(path, workers=2) as held, Session(path, workers=2, held=False) as passed:
            for other in (held, passed, stored):
                assert other.volume.survey == single.volume.survey
                assert other.volume.density_counts == single.volume.density_counts
                assert other.volume.strength_counts == single.volume.strength_counts
    assert sum(single.volume.density_counts) == SIDE**3


def narrower(values: NDArray[np.float64], scalar_type: str = "float32", kind: Kind = Kind.UNKNOWN) -> Survey | None:
    """Of a volume whose every voxel is a block."""
    low, high = float(values.min()), float(values.max())
    counts, _ = np.histogram(values, HISTOGRAM_BINS, (low, high))
    each = values.tolist()
    survey = Survey(low, high, max_gradient=high - low, voxels=len(each), no_data=0)
    return narrowed(survey, counts.tolist(), BlockExtremes(each, each), scalar_type, kind)


def test_what_differs_from_one_value_is_what_there_is_to_see() -> None:
    few = np.zeros(10_000)
    few[:3] = 1.0, 2.0, 3.0
    assert narrower(few) is None


def test_labels_and_whole_numbers_that_bins_tell_apart_are_counted_once() -> None:
    values = np.arange(10_000.0) % 50
    values[7] = 60_000.0
    assert narrower(values, "uint16") is None
    assert narrower(values, "int32", Kind.LABELS) is None
    assert narrower(values) is not None


@pytest.mark.parametrize(("scale", "told"), [(1e-100, False), (1e-200, True)])
def test_values_too_small_for_light_are_told_of(scale: float, told: bool, tmp_path: Path) -> None:
    np.save(tmp_path / "ball.npy", noisy_ball().astype(np.float64) * scale)
    with SingleProcess(tmp_path / "ball.npy") as single:
        assert any("little light or none" in note for note in single.volume.notes()) == told
