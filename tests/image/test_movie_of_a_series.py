"""Movies of several volumes: each in its turn, seen as the first is."""

from pathlib import Path

import msgspec
import nibabel
import numpy as np
import pytest

from support.files.images import over_background, read_image
from support.programs.programs import Person
from tolerances import HALF_A_LEVEL
from volsplat.client.image.image_file import read_scene
from volsplat.client.movie.volumes_in_turn import first_frame
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.scene import Scene

STEPS = 3
SIZE = (20, 18, 16)
BOTH = pytest.mark.parametrize("how", [("--workers", "1"), ("--single",)], ids=["servers", "single"])


@pytest.fixture
def person(tmp_path: Path) -> Person:
    return Person(tmp_path)


@pytest.fixture
def series(person: Person) -> list[str]:
    """A ball that grows brighter and moves, the time points of one file."""
    i, j, k = np.indices(SIZE)
    balls = [
        (1 + step) * 1000 * np.exp(-((i - 6 - 4 * step) ** 2 + (j - 9) ** 2 + (k - 8) ** 2) / 12)
        for step in range(STEPS)
    ]
    values = np.stack(balls, axis=-1).astype(np.float32)
    nibabel.save(nibabel.Nifti1Image(values, np.diag([2, 2, 3, 1])), person.folder / "beat.nii")
    return [f"beat.nii#{step}" for step in range(STEPS)]


def frames(folder: Path) -> list[Path]:
    return sorted(folder.iterdir())


@BOTH
def test_each_volume_is_shown_in_its_turn_with_the_window_and_view_of_the_first(
    person: Person, series: list[str], how: tuple[str, ...]
) -> None:
    done = person.runs("movie", *series, "-o", "beat", "--size", "48x40", *how)
    assert done.returncode == 0, done.stderr
    images = frames(person.folder / "beat")
    assert len(images) == STEPS
    scenes = [read_scene(image) for image in images]
    with SingleProcess(str(person.folder / series[0])) as first:
        chosen = first.volume.windowed(first.volume.settled(sized(first.volume.default_scene(), scenes[0])))
    assert scenes == [chosen] * STEPS
    for image, volume in zip(images, series, strict=True):
        with SingleProcess(str(person.folder / volume)) as single:
            shown = over_background(single.render(chosen), chosen.image.background)
        assert (read_image(image) - shown).abs().max() <= HALF_A_LEVEL["uint8"]
    assert (read_image(images[0]) - read_image(images[2])).abs().max() > 0.2


def sized(scene: Scene, like: Scene) -> Scene:
    return msgspec.structs.replace(scene, image=like.image)


def test_volumes_share_the_frames_evenly_and_may_turn_meanwhile(person: Person, series: list[str]) -> None:
    done = person.runs(
        "movie", *series, "-o", "turn", "--size", "24x24", "--single", "--frames", "7", "--axis", "screen-y"
    )
    assert done.returncode == 0, done.stderr
    images = frames(person.folder / "turn")
    rotations = [read_scene(image).view.rotation for image in images]
    assert len(set(rotations)) == len(images) == 7
    assert [first_frame(number, series, 7) for number in range(STEPS + 1)] == [0, 3, 5, 7]


@pytest.mark.parametrize(
    ("arguments", "cause"),
    [
        (("--frames", "2"), "--frames 2 shows not all of the 3 volumes; give one frame each or more"),
        (("--trace", "t.json"), "--trace records the servers of one volume; leave it out"),
    ],
)
def test_what_cannot_be_of_several_volumes_is_refused(
    person: Person, series: list[str], arguments: tuple[str, ...], cause: str
) -> None:
    done = person.runs("movie", *series, "-o", "beat", *arguments)
    assert (done.returncode, done.stderr) == (2, f"volsplat: {cause}\n")
    assert not (person.folder / "beat").exists()


def test_a_volume_on_another_grid_ends_it_and_nothing_is_left(person: Person, series: list[str]) -> None:
    write_volume(person.folder / "other.nrrd", *make_phantom("head", SIZE[::-1]))
    done = person.runs("movie", *series, "other.nrrd", "-o", "beat", "--size", "16x16", "--single")
    assert done.returncode == 2
    assert "other.nrrd: 16 x 18 x 20 voxels" in done.stderr and "need grids of the same size and spacing" in done.stderr
    assert not (person.folder / "beat").exists()
