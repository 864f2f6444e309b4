"""The gallery: sixteen images from scene files, on four plates, of measured volumes if there are some."""

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from support.files.images import read_image
from support.programs.programs import Person
from support.scenes.arbitrary import plain_scene
from volsplat.client.gallery.drawing import Drawn, draw_gallery, gallery_folder, label, plate_sheet, sized
from volsplat.client.gallery.plates import (
    IMAGES,
    PLATES,
    SCENES,
    STRUCTURE_FACTORS,
    DataSet,
    PlateImage,
    scene_path,
    step_of,
)
from volsplat.client.image.image_file import read_properties, read_scene
from volsplat.client.image.picture_sheet import PAPER, SheetPicture, picture_sheet
from volsplat.client.phantoms import PHANTOMS, make_phantom, streamed_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.scene.scene_file import read_scene_file
from volsplat.client.session.renderer import Renderer
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene, View
from volsplat.protocol.rules.refinement import PAPER_STEPS
from volsplat.protocol.text.errors import BadInput, VolsplatError

KINDS = [(image, measured) for image in IMAGES for measured in (False, True) if not measured or image.data.measured]


def scene_of(name: str, measured: bool) -> Scene:
    image = next(image for image in IMAGES if image.name == name)
    return read_scene_file(scene_path(image, measured), plain_scene())


def volume_name(path: Path) -> str:
    name = msgspec.json.decode(read_properties(path)["volume"])["name"]
    assert isinstance(name, str)
    return name


def test_there_are_sixteen_images_on_four_plates() -> None:
    assert len(PLATES) == 4 and len({image.name for image in IMAGES}) == 16
    assert {image.data.phantom for image in IMAGES} <= PHANTOMS.keys()
    assert [image.step for image in IMAGES[:6]] == list(PAPER_STEPS)


@pytest.mark.parametrize(("image", "measured"), KINDS, ids=lambda value: getattr(value, "name", str(value)))
def test_a_scene_file_says_all_that_decides_the_picture(image: PlateImage, measured: bool) -> None:
    """So that it draws the same over any other scene; and the volume's boundary is seen, as in the paper."""
    text = scene_path(image, measured).read_text(encoding="utf-8")
    for key in ("emit", "refl", "opac", "modu"):
        assert f"[tables.{key}]" in text
    for part in ("[cross_bar]", "[shading]", "[view]", "[quantise]"):
        assert part in text
    scene = read_scene_file(scene_path(image, measured), plain_scene())
    assert scene.image.edges and scene.image.width == scene.image.height


def test_every_scene_file_is_of_some_image() -> None:
    used = {scene_path(image, measured) for image, measured in KINDS}
    assert used == set(SCENES.rglob("*.toml"))


@pytest.mark.parametrize(("pair", "measured"), [("galaxy", False), ("galaxy", True), ("seismic", False)])
def test_only_a_rotation_tells_the_two_views_apart(pair: str, measured: bool) -> None:
    first, second = scene_of(f"{pair}-1", measured), scene_of(f"{pair}-2", measured)
    assert first.view.rotation != second.view.rotation
    turned = msgspec.structs.replace(second.view, rotation=first.view.rotation)
    assert msgspec.structs.replace(second, view=turned) == first


def test_the_tables_are_what_the_paper_says() -> None:
    bone = scene_of("head-bone", measured=True)
    assert all(green > max(red, blue) for red, green, blue in bone.tables.refl.entries())
    clipped = scene_of("head-clipped", measured=True)
    assert clipped.shading.modulation and clipped.cross_bar.modu == "strength"
    assert clipped.bounds.high[0] < 96
    assert scene_of("rna", measured=True).cross_bar.emit == "strength"
    colours = scene_of("protein", measured=True).tables.refl.entries()
    carbon, nitrogen, oxygen, sulphur = (colours[byte] for byte in (80, 112, 144, 208))
    assert max(carbon) == carbon[1] and max(nitrogen) == nitrogen[2] and max(oxygen) == oxygen[0]
    assert min(sulphur) == sulphur[2] and min(sulphur[:2]) > 2 * sulphur[2]


def test_an_image_of_another_size_shows_as_much() -> None:
    scene = msgspec.structs.replace(scene_of("rna", measured=False), view=View(zoom=5.0))
    assert sized(scene, 256).view.zoom == 2.5 and sized(scene, 256).image.height == 256
    assert sized(msgspec.structs.replace(scene, view=View()), 256).view.zoom == "fit"


# From phantoms alone, by the command.


@pytest.fixture(scope="module")
def person(tmp_path_factory: pytest.TempPathFactory) -> Person:
    return Person(tmp_path_factory.mktemp("gallery"))


@pytest.fixture(scope="module")
def made(person: Person) -> "subprocess.CompletedProcess[str]":
    return person.runs("gallery", "out", "--size", "96", "--workers", "1")


def test_the_command_makes_every_file_and_tells_so_in_one_line(
    person: Person, made: "subprocess.CompletedProcess[str]"
) -> None:
    assert made.returncode == 0, made.stderr
    (line,) = made.stderr.splitlines()
    assert line.startswith("out: 16 images and 4 plates, ")
    files = {path.name for path in (person.folder / "out").iterdir()}
    assert files == {f"{image.name}.png" for image in IMAGES} | {f"plate-{n}.png" for n in (1, 2, 3, 4)}
    assert person.servers() == []


@pytest.mark.parametrize("image", IMAGES, ids=lambda image: image.name)
def test_an_image_shows_its_phantom_within_white_edges(
    person: Person, made: "subprocess.CompletedProcess[str]", image: PlateImage
) -> None:
    path = person.folder / "out" / f"{image.name}.png"
    pixels = read_image(path)
    assert pixels.shape[:2] == (96, 96)
    assert (pixels.amax(dim=2) > 0.1).double().mean().item() > 0.03  # not the edges alone
    assert (pixels.amin(dim=2) > 0.5).any() and (pixels.amax(dim=2) - pixels.amin(dim=2) > 0.2).any()
    assert volume_name(path) == f"{image.data.phantom}.nrrd"
    phantom, known = streamed_phantom(image.data.phantom), msgspec.json.decode(read_properties(path)["volume"])
    assert known["kind"] == phantom.kind and len(known["bands"]) == len(phantom.bands)
    drawn, told = read_scene(path), sized(scene_of(image.name, measured=False), 96)
    for part in ("tables", "cross_bar", "view", "bounds", "image", "quantise", "reconstruction"):
        assert getattr(drawn, part) == getattr(told, part)


def test_no_two_images_are_the_same(person: Person, made: "subprocess.CompletedProcess[str]") -> None:
    contents = {(person.folder / "out" / f"{image.name}.png").read_bytes() for image in IMAGES}
    assert len(contents) == 16


def test_a_plate_holds_its_four_images_in_their_places(
    person: Person, made: "subprocess.CompletedProcess[str]"
) -> None:
    for plate in PLATES:
        sheet = read_image(person.folder / "out" / f"plate-{plate.number}.png")
        images = [read_image(person.folder / "out" / f"{image.name}.png") for image in plate.images]
        found = [place_of(sheet, image) for image in images]
        (top, left), (same_top, right), (bottom, same_left), (same_bottom, same_right) = found
        assert top == same_top < bottom == same_bottom and left == same_left < right == same_right


def place_of(sheet: torch.Tensor, image: torch.Tensor) -> tuple[int, int]:
    """Where an image lies unchanged in a sheet: row and column."""
    windows = sheet.unfold(0, image.shape[0], 1).unfold(1, image.shape[1], 1)
    corner = windows[:, :, :, 40, 40] == image[40, 40]
    for row, column in torch.nonzero(corner.all(dim=2)).tolist():
        if torch.equal(sheet[row : row + image.shape[0], column : column + image.shape[1]], image):
            return row, column
    raise AssertionError("the image is not in the sheet")


def test_a_plate_says_below_each_image_what_it_was_made_of() -> None:
    black = np.zeros((300, 300, 3), np.float32)
    plain, labelled = (
        plate_sheet(PLATES[0], {image.name: Drawn(black, label) for image in PLATES[0].images})
        for label in ("", "CT of a head (UNC), 96 x 128 x 113")
    )
    assert labelled.shape[0] > plain.shape[0]
    strips = labelled[300 + 60 :][: labelled.shape[0] - plain.shape[0] + 24]
    assert strips.max() > 2 * PAPER


@pytest.mark.parametrize(("image", "measured"), KINDS, ids=lambda kind: getattr(kind, "name", str(kind)))
def test_words_below_a_small_image_leave_its_legend_and_its_neighbour_alone(image: PlateImage, measured: bool) -> None:
    grey, sides = 0.5, []

    def legend(side: int, paper: float) -> NDArray[np.float32]:
        sides.append(side)
        return np.full((side, side, 3), grey, np.float32)

    picture = np.full((64, 64, 3), PAPER, np.float32)
    note = label(image.data, measured, (100, 100, 100)) + ", step G"
    explained = image.data is STRUCTURE_FACTORS
    shown = SheetPicture(picture, image.mark, image.caption, note=note, legend=legend if explained else None)
    sheet = picture_sheet([shown, SheetPicture(picture, "", "")], columns=2)
    assert (sheet == np.float32(grey)).all(axis=2).sum() == sum(side**2 for side in sides)
    assert (sheet[:, sheet.shape[1] // 2 :] == np.float32(PAPER)).all()


@pytest.mark.parametrize("measured", [False, True])
@pytest.mark.parametrize("data_set", dict.fromkeys(image.data for image in IMAGES), ids=lambda one: one.phantom)
def test_a_label_says_what_a_volume_is_and_its_size(data_set: DataSet, measured: bool) -> None:
    text = label(data_set, measured, (96, 128, 113))
    assert text.startswith(data_set.measured_label if measured else data_set.phantom_label)
    assert text.endswith(", 96 x 128 x 113") and text.count(" x ") == 2


def test_a_plate_explains_the_colours_of_phases() -> None:
    black = np.zeros((512, 512, 3), np.float32)
    red, green = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    plain = {image.name: Drawn(black, "a label") for image in PLATES[2].images}
    explained = {**plain, "structure-factors": Drawn(black, "a label", (red, green))}
    before, after = plate_sheet(PLATES[2], plain), plate_sheet(PLATES[2], explained)
    assert before.shape == after.shape
    for colour in (red, green):
        assert not (before == np.array(colour)).all(axis=2).any()
        assert (after == np.array(colour)).all(axis=2).any()


# With measured volumes.


class Opening:
    """Opens volumes in this process, and remembers which."""

    def __init__(self) -> None:
        self.names: list[str] = []

    @contextmanager
    def __call__(self, volume: str) -> Iterator[Renderer]:
        self.names.append(volume)
        with SingleProcess(volume) as single:
            yield single


def drawn_with(data: Path | None, folder: Path, last: Step = Step.F) -> tuple[Opening, list[int]]:
    opening = Opening()
    counts: list[int] = []
    with gallery_folder(folder, data):
        draw_gallery(folder, data, 64, opening, lambda text: None, counts.append, last)
    return opening, counts


def test_measured_volumes_are_taken_where_they_are_and_each_is_opened_once(tmp_path: Path) -> None:
    data = tmp_path / "data"
    (data / "ct_head").mkdir(parents=True)
    write_volume(data / "ct_head" / "ct_head_96x128x113.nrrd", *make_phantom("slab", size=(96, 128, 113)))
    opening, counts = drawn_with(data, tmp_path / "out")
    assert counts == list(range(1, 17))
    assert opening.names[0] == str(data / "ct_head" / "ct_head_96x128x113.nrrd")
    assert [Path(name).name for name in opening.names[1:]] == [
        *("p-orbital.nrrd", "rna.nrrd", "protein.nrrd", "structure-factors.nrrd", "galaxy.nrrd", "seismic.nrrd")
    ]
    assert not any(Path(name).exists() for name in opening.names[1:])  # phantoms are gone with their sessions
    assert volume_name(tmp_path / "out" / "head-bone.png") == "ct_head_96x128x113.nrrd"
    assert volume_name(tmp_path / "out" / "rna.png") == "rna.nrrd"


def test_every_measured_volume_of_the_shared_data_is_drawn(shared_data: Path, tmp_path: Path) -> None:
    """In step G too; classes and structure factors, which have none, as in F."""
    for library in ("gemmi", "astropy", "segyio"):
        pytest.importorskip(library)
    opening, _ = drawn_with(shared_data, tmp_path / "out", Step.G)
    for image in IMAGES:
        path = tmp_path / "out" / f"{image.name}.png"
        measured = bool(image.data.measured)
        assert volume_name(path) == (Path(image.data.measured).name if measured else f"{image.data.phantom}.nrrd")
        assert (read_image(path).amax(dim=2) > 0.1).double().mean().item() > 0.03
    assert len(opening.names) == len({image.data for image in IMAGES})


def test_what_has_no_in_between_stays_in_step_f() -> None:
    """Phantoms that hold kinds of atoms or phases in bands of values, and volumes that G refuses."""
    for image in IMAGES:
        banded = image.name in ("protein", "structure-factors")
        g = Step.G if image.step == Step.F else image.step
        assert step_of(image, False, Step.G, lambda _: True) == (image.step if banded else g)
        assert step_of(image, True, Step.G, lambda _: True) == g
        assert step_of(image, True, Step.G, lambda _: False) == image.step


# Bad input.


def one_line(done: "subprocess.CompletedProcess[str]") -> str:
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    return line


def test_mistakes_are_one_line_that_names_the_cure(person: Person) -> None:
    (person.folder / "taken").write_text("")
    assert "--data" in one_line(person.runs("gallery", "out2", "--data", "nowhere"))
    assert "name another" in one_line(person.runs("gallery", "taken"))
    assert "--size" in one_line(person.runs("gallery", "out2", "--size", "1"))
    assert "--workers" in one_line(person.runs("gallery", "out2", "--workers", "0"))
    assert not (person.folder / "out2").exists()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written_is_refused_before_anything_is_drawn(tmp_path: Path) -> None:
    (tmp_path / "locked").mkdir(mode=0o500)
    with pytest.raises(BadInput, match="locked"), gallery_folder(tmp_path / "locked", None):
        pass


def test_folders_without_an_image_are_gone_again_unless_they_were_there(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    for place in ("there", "there/new/out"):
        with pytest.raises(VolsplatError), gallery_folder(tmp_path / place, None):
            raise VolsplatError("no servers")
        assert list(tmp_path.rglob("*")) == [tmp_path / "there"]


def test_a_damaged_measured_volume_is_named(person: Person) -> None:
    """It is not passed over in silence for the phantom."""
    damaged = person.folder / "data" / "ct_head" / "ct_head_96x128x113.nrrd"
    damaged.parent.mkdir(parents=True)
    damaged.write_bytes(b"NRRD0005\ntype: uint8\n")
    done = person.runs("gallery", "out3", "--data", "data", "--size", "64", "--workers", "1")
    assert damaged.name in one_line(done)
    assert person.servers() == []
