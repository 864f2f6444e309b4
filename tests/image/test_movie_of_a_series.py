"""Movies of several volumes: each in its turn, seen as the first is."""

from pathlib import Path

import msgspec
import nibabel
import numpy as np
import pytest
from numpy.typing import NDArray

from support.files.images import over_background, read_image
from support.programs.programs import Person
from tolerances import HALF_A_LEVEL
from volsplat.client.image.image_file import read_scene
from volsplat.client.movie.volumes_in_turn import OWN_STRENGTHS, first_frame
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
        fitted = first.volume.fitted_to_turn(sized(first.volume.default_scene(), scenes[0]))
        chosen = first.volume.windowed(first.volume.settled(fitted))
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


def test_bars_of_a_figure_are_of_all_volumes_and_not_of_the_first_alone(person: Person, series: list[str]) -> None:
    shown = ("--size", "240x160", "--single", "--figure")
    done = person.runs("movie", *series, "-o", "beat", "--window", "0,3000", *shown)
    assert done.returncode == 0, done.stderr
    scene = str(frames(person.folder / "beat")[0])
    done = person.runs("movie", *series[::-1], "-o", "back", "--scene", scene, *shown)
    assert done.returncode == 0, done.stderr
    for there, back in zip(frames(person.folder / "beat"), frames(person.folder / "back")[::-1], strict=True):
        assert (read_image(there) == read_image(back)).all()


def saved(person: Person, name: str, values: NDArray[np.float32], intent: str = "none") -> str:
    image = nibabel.Nifti1Image(values, np.diag([2, 2, 3, 1]))
    image.header.set_intent(intent)
    image.header.set_xyzt_units("mm")
    nibabel.save(image, person.folder / name)
    return name


def test_a_file_without_content_is_refused_before_anything_is_drawn(person: Person, series: list[str]) -> None:
    (person.folder / "cut.nii").touch()
    done = person.runs("movie", *series, "cut.nii", "-o", "beat", "--size", "16x16", "--single")
    assert done.returncode == 2
    assert done.stderr == "volsplat: cut.nii: the file is empty; fetch or export the volume again\n"


def test_what_is_unusual_about_any_volume_is_told_once_and_one_without_values_is_empty(person: Person) -> None:
    ball = np.fromfunction(lambda i, j, k: 1000 * np.exp(-((i - 9) ** 2 + (j - 9) ** 2 + (k - 8) ** 2) / 12), SIZE)
    volumes = [
        saved(person, f"{name}.nii", np.asarray(values, np.float32))
        for name, values in {"ball": ball, "gone": np.full(SIZE, np.nan), "flat": ball * 0, "even": ball * 0}.items()
    ]
    done = person.runs("movie", *volumes, "-o", "beat", "--size", "16x16", "--single")
    assert done.returncode == 0, done.stderr
    notes = [line for line in done.stderr.splitlines() if line.startswith("note: ")]
    assert notes == [
        "note: gone.nii: no voxel has a value, all are NaN or infinite: nothing of it is seen",
        "note: flat.nii: every voxel has the value 0: the volume is a block without structure",
    ]
    shown, gone, *_ = map(read_image, frames(person.folder / "beat"))
    assert (gone == gone[0, 0]).all() and not (shown == shown[0, 0]).all()


def test_values_of_another_kind_end_it_and_nothing_is_left(person: Person, series: list[str]) -> None:
    labels = saved(person, "labels.nii", np.ones(SIZE, np.float32), "label")
    done = person.runs("movie", *series, labels, "-o", "beat", "--size", "16x16", "--single")
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == (
        "volsplat: labels.nii: labels, without a unit, but beat.nii#0 has values of no told kind, without a unit; "
        "the volumes of a movie need values of one kind, in one unit"
    )
    assert not (person.folder / "beat").exists()


@pytest.mark.parametrize(("modulated", "told"), [("true", 1), ("false", 0)])
def test_strengths_are_told_to_be_each_volumes_own_where_they_are_shown(
    person: Person, series: list[str], modulated: str, told: int
) -> None:
    (person.folder / "look.toml").write_text(f"shading.modulation = {modulated}\n")
    done = person.runs("movie", *series, "-o", "beat", "--size", "16x16", "--single", "--scene", "look.toml")
    assert done.returncode == 0, done.stderr
    assert done.stderr.count(f"note: {OWN_STRENGTHS}") == told


def test_a_prepared_volume_gives_its_window_to_others_and_takes_none(person: Person, series: list[str]) -> None:
    for volume, window in zip(series, ("0,500", "0,500", "0,700"), strict=True):
        done = person.runs("prepare", volume, f"{volume[-1]}.zarr", "--window", window)
        assert done.returncode == 0, done.stderr
    shown = ("--size", "16x16", "--single")
    done = person.runs("movie", "0.zarr", series[1], "1.zarr", "-o", "beat", *shown)
    assert done.returncode == 0, done.stderr
    first, own, prepared = frames(person.folder / "beat")
    assert {read_scene(image).quantise.window for image in (first, own, prepared)} == {(0.0, 500.0)}
    assert (read_image(own) - read_image(prepared)).abs().max() <= HALF_A_LEVEL["uint8"]
    done = person.runs("movie", "0.zarr", "2.zarr", "-o", "not", *shown)
    assert done.returncode == 2
    assert "beat.nii#2 was prepared with the window 0 to 700; for another one prepare it again with --window 0,500" in (
        done.stderr
    )
    assert not (person.folder / "not").exists()


def test_a_volume_on_another_grid_ends_it_and_nothing_is_left(person: Person, series: list[str]) -> None:
    write_volume(person.folder / "other.nrrd", *make_phantom("head", SIZE[::-1]))
    done = person.runs("movie", *series, "other.nrrd", "-o", "beat", "--size", "16x16", "--single")
    assert done.returncode == 2
    assert "other.nrrd: 16 x 18 x 20 voxels" in done.stderr and "need grids of the same size and spacing" in done.stderr
    assert not (person.folder / "beat").exists()
