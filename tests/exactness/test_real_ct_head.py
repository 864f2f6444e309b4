"""The real CT head: the same files from any number of workers, the reference's picture, steps as the paper tells."""

from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
import SimpleITK
import torch
from torch import Tensor

from reference import render, voxel_packets
from support.files.images import read_image
from support.programs.programs import Person
from support.scenes.rendering import TableWeights
from tolerances import ONE_LEVEL, SURFACE_VOXELS
from volsplat.client.scene.presets import preset_scene
from volsplat.client.scene.scene_file import read_scene_file, scene_toml
from volsplat.client.session.session import Session
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Image, Quantise, Scene, View
from volsplat.protocol.description.view_rotation import named_view, rotation_from_option
from volsplat.protocol.rules.refinement import PAPER_STEPS

PAPER_SIZE = "ct_head/ct_head_96x128x113.nrrd"
FULL_SIZE = "ct_head/cthead_256x256x113.nrrd"
HEADS = [PAPER_SIZE, FULL_SIZE]
SKIN_VALUE = 50  # of the paper-size head: half-way from air to skin
OPAQUE = 0.9


@pytest.fixture(scope="module")
def heads(shared_data: Path) -> Iterator[dict[str, SingleProcess]]:
    with SingleProcess(shared_data / PAPER_SIZE) as small, SingleProcess(shared_data / FULL_SIZE) as full:
        yield {PAPER_SIZE: small, FULL_SIZE: full}


def head_scene(head: SingleProcess, preset: str, view: View, size: tuple[int, int]) -> Scene:
    scene = preset_scene(preset, head.volume.subject())
    return msgspec.structs.replace(scene, view=view, image=Image(width=size[0], height=size[1]))


def from_the_front(head: SingleProcess, preset: str, step: Step) -> Tensor:
    """The head upright, its face to the viewer, two pixels a reference spacing."""
    view = View(rotation=named_view("front"), up="-z", zoom=2.0)
    return head.render(head_scene(head, preset, view, (256, 256)), step)


def brightness(image: Tensor) -> Tensor:
    return image[..., :3].double().mean(dim=-1)


def variation(image: Tensor) -> float:
    """How much neighbouring pixels differ, of all light."""
    light = brightness(image)
    return float((light.diff(dim=0).abs().sum() + light.diff(dim=1).abs().sum()) / light.sum())


def share_with_half_the_light(light: Tensor) -> float:
    """The smallest share of the pixels (n,) that holds half of the light."""
    brightest_first = light.sort(descending=True).values.cumsum(0)
    return float((brightest_first < brightest_first[-1] / 2).double().mean())


# One picture


@pytest.mark.parametrize(("head", "counts"), [(PAPER_SIZE, ("1", "2", "4")), (FULL_SIZE, ("4",))])
def test_files_are_the_same_for_1_2_and_4_workers_and_a_single_process(
    shared_data: Path, tmp_path: Path, head: str, counts: tuple[str, ...]
) -> None:
    person = Person(tmp_path)
    arguments = ["render", str(shared_data / head), "--preset", "ct-skin", "--size", "256x256", "--edges"]
    folders = {"single": ["--single"], **{workers: ["--workers", workers] for workers in counts}}
    files: dict[str, list[bytes]] = {}
    for folder, how in folders.items():
        (tmp_path / folder).mkdir()
        done = person.runs(*arguments, *how, "-o", f"{folder}/head.exr", "--steps-dir", folder)
        assert done.returncode == 0, done.stderr
        paths = [tmp_path / folder / "head.exr", *(tmp_path / folder / f"step-{step}.png" for step in PAPER_STEPS)]
        files[folder] = [path.read_bytes() for path in paths]
    for folder in folders:
        assert files[folder] == files["single"], folder
    assert (read_image(tmp_path / "single" / "head.exr")[..., 3] > OPAQUE).double().mean() > 0.1
    assert person.servers() == []


def test_a_scene_file_gives_one_picture_distributed_single_and_by_the_reference(
    shared_data: Path, tmp_path: Path, heads: dict[str, SingleProcess]
) -> None:
    path, single = shared_data / PAPER_SIZE, heads[PAPER_SIZE]
    geometry = single.volume.description.geometry
    values = torch.from_numpy(SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(str(path))))
    view = View(rotation=rotation_from_option("-30,15,10"), zoom=1.07, center=(45.0, 60.5, 58.0))
    quantisation = single.volume.quantisation(Quantise())
    packets = voxel_packets.pack(values, geometry, quantisation)
    with Session(path, workers=3) as session:
        for preset, steps in (("ct-skin", (Step.A, Step.C, Step.F)), ("ct-bone", (Step.B, Step.F))):
            file = tmp_path / f"{preset}.toml"
            file.write_text(scene_toml(head_scene(single, preset, view, (150, 140))))
            scene = read_scene_file(file, session.default_scene())
            assert scene.quantise == Quantise()
            settled = single.volume.settled(scene)
            for step in steps:
                weights = TableWeights(settled, geometry, step) if step >= Step.D else None
                expected = render.render(packets, geometry, quantisation, settled, step, exact=False, weights=weights)
                image = session.render(scene, step)
                assert torch.equal(image, single.render(scene, step))
                assert (image - expected).abs().max() <= ONE_LEVEL
                assert (image[..., 3] > OPAQUE).double().mean() > 0.1


def test_the_command_draws_a_scene_file_as_python_does(
    shared_data: Path, tmp_path: Path, heads: dict[str, SingleProcess]
) -> None:
    single = heads[PAPER_SIZE]
    view = View(rotation=rotation_from_option("40,10"), zoom=1.5)
    file = tmp_path / "bone.toml"
    file.write_text(scene_toml(head_scene(single, "ct-bone", view, (200, 190))))
    scene = read_scene_file(file, single.volume.default_scene())
    for how in (["--single"], ["--workers", "2"]):
        done = Person(tmp_path).runs("render", str(shared_data / PAPER_SIZE), "--scene", str(file), "-o", "a.exr", *how)
        assert done.returncode == 0, done.stderr
        assert torch.equal(read_image(tmp_path / "a.exr"), single.render(scene))


# The six steps


@pytest.mark.parametrize("preset", ["ct-skin", "ct-bone"])
def test_a_b_and_c_are_blocky_and_d_is_not(heads: dict[str, SingleProcess], preset: str) -> None:
    """Seen straight on, all sheets' cells lie one behind the other: one colour for each 4, 2 and 1 voxels square."""
    ni, _, nk = heads[PAPER_SIZE].volume.description.geometry.dims
    across = (torch.arange(256) - 127.5) / 2  # voxels from the image's middle; -x is on the right, -z is up
    i, k = (ni - 1) / 2 - across, (nk - 1) / 2 + across
    images = {step: from_the_front(heads[PAPER_SIZE], preset, step) for step in PAPER_STEPS}
    distinct = {}
    for step, side in ((Step.A, 4), (Step.B, 2), (Step.C, 1)):
        columns, rows = ((index + 0.5).div(side, rounding_mode="floor").long() for index in (i, k))
        whole = k + 0.5 < nk // side * side  # a clipped last cell is another's part
        blocky, smooth = (images[s] == at_first_pixels(images[s], rows, columns) for s in (step, Step.D))
        assert blocky[whole].all() and not smooth[whole].all()
        distinct[step] = len(torch.unique(images[step].reshape(-1, 4), dim=0))
    assert distinct[Step.A] < distinct[Step.B] < distinct[Step.C]


def at_first_pixels(image: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
    """Every pixel as the first one of its cell, whose row and column (256,) are given."""
    first_y, first_x = (
        torch.stack([torch.nonzero(cells == cell)[0, 0] for cell in cells]) for cells in (rows, columns)
    )
    return image[first_y][:, first_x]


@pytest.mark.parametrize("preset", ["ct-skin", "ct-bone"])
@pytest.mark.parametrize("head", HEADS)
def test_d_is_smooth(heads: dict[str, SingleProcess], head: str, preset: str) -> None:
    nearest, footprints = (from_the_front(heads[head], preset, step) for step in (Step.C, Step.D))
    assert variation(footprints) < variation(nearest)
    opaque = (nearest[..., 3] > OPAQUE) == (footprints[..., 3] > OPAQUE)
    assert opaque.double().mean() > OPAQUE, "it is the same head"


@pytest.mark.parametrize("preset", ["ct-skin", "ct-bone"])
@pytest.mark.parametrize("head", HEADS)
def test_e_is_lit_and_f_has_highlights(heads: dict[str, SingleProcess], head: str, preset: str) -> None:
    emitted, diffuse, specular = (from_the_front(heads[head], preset, step) for step in (Step.D, Step.E, Step.F))
    assert torch.equal(emitted[..., 3], diffuse[..., 3]) and torch.equal(emitted[..., 3], specular[..., 3])
    reflected, highlights = brightness(diffuse - emitted), brightness(specular - diffuse)
    assert reflected.min() >= 0 and highlights.min() >= 0
    opaque = emitted[..., 3] > OPAQUE
    assert (reflected > ONE_LEVEL)[opaque].double().mean() > OPAQUE
    assert 0 < share_with_half_the_light(highlights[opaque]) < share_with_half_the_light(reflected[opaque]) / 2
    assert variation(diffuse) > variation(emitted), "light shows the shape"
    assert brightness(specular).max() > brightness(diffuse).max() > brightness(emitted).max()


def test_light_from_the_left_lights_the_left_of_the_face(heads: dict[str, SingleProcess]) -> None:
    head = heads[PAPER_SIZE]
    scene = head_scene(head, "ct-skin", View(rotation=named_view("front"), up="-z", zoom=2.0), (256, 256))
    sides = {}
    for side, x in (("left", -1.0), ("right", 1.0)):
        light = msgspec.structs.replace(scene.light, direction=(x, 0.0, 0.5), fixed_to="world")
        sides[side] = brightness(head.render(msgspec.structs.replace(scene, light=light), Step.E))
    assert sides["left"][:, :128].sum() > sides["right"][:, :128].sum()
    assert sides["left"][:, 128:].sum() < sides["right"][:, 128:].sum()


# Skin and bone


def test_the_skin_preset_shows_the_skin_s_depth(shared_data: Path, heads: dict[str, SingleProcess]) -> None:
    """Its emitted light tells the depth: that of each ray's first voxel of skin, which plain data gives."""
    head = heads[PAPER_SIZE]
    ni, nj, nk = head.volume.description.geometry.dims
    values = torch.from_numpy(SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(str(shared_data / PAPER_SIZE))))
    solid = (values > SKIN_VALUE).flip(2)  # -x is on the right
    first, hit = solid.byte().argmax(dim=1).double(), solid.any(dim=1)
    scene = head_scene(head, "ct-skin", View(rotation=named_view("front"), up="-z", zoom=1.0), (ni, nk))
    image = head.render(scene, Step.D).double()
    (near_z, dark), (far_z, light) = scene.tables.emit.points
    along = (brightness(image) / image[..., 3] - sum(dark) / 3) / (sum(light) / 3 - sum(dark) / 3)
    radius = (ni**2 + nj**2 + nk**2) ** 0.5 / 2
    depth = (nj - 1) / 2 - (2 * (near_z + along * (far_z - near_z)) - 1) * radius
    told = hit & (image[..., 3] > 0.99) & (along > 0.02) & (along < 0.98)
    assert told.double().mean() > 0.4
    assert ((depth - first).abs() <= SURFACE_VOXELS)[told].double().mean() > 0.9


@pytest.mark.parametrize("head", HEADS)
def test_the_skull_is_smaller_than_the_face_and_inside_it(heads: dict[str, SingleProcess], head: str) -> None:
    for rotate in ("front", "-60,10"):
        view = View(rotation=rotation_from_option(rotate), zoom=1.5)
        skin, bone = (
            heads[head].render(head_scene(heads[head], preset, view, (256, 256)))[..., 3] > 0.5
            for preset in ("ct-skin", "ct-bone")
        )
        assert 0.1 * skin.sum() < bone.sum() < 0.9 * skin.sum()
        assert not (bone & ~skin).any()
