"""Volumes that were prepared: drawn by levels from a packet store, by sessions and single processes alike."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import msgspec
import psutil
import pytest
import torch

from support.files.head_volume import skin
from support.files.silent_progress import Silent
from support.patience import wait_until
from support.programs.server_processes import is_server
from support.scenes.level_brightness import ALONG_AXES, OBLIQUE, Bright, measured
from tolerances import LEVEL_BRIGHTNESS, THIN_LEVEL_BRIGHTNESS
from volsplat.client import Session
from volsplat.client.coordinator.holding.base_level import LevelChoice, budgets
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.scene.presets import preset_scene
from volsplat.client.session.renderer import Refinement, Renderer
from volsplat.client.session.single import SingleProcess
from volsplat.mapshade_server.held.kept_packets import stored_sub_cubes
from volsplat.mapshade_server.held.packet_store import open_store
from volsplat.mapshade_server.held.volume_identity import identified_store
from volsplat.mapshade_server.held.wanted_reader import GivenUp
from volsplat.mapshade_server.held_volume import HeldVolume
from volsplat.mapshade_server.prepare import Options, prepare
from volsplat.mapshade_server.prepare.layout import Layout
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Image, Quantise, Reconstruction, Refine, Scene, View
from volsplat.protocol.description.volume import Box
from volsplat.protocol.messages.messages import CountHistograms, LevelBoxes, OpenPackets, VoxelsPacked
from volsplat.protocol.text.errors import BadInput

SIZE = (61, 64, 50)  # voxels
BRICKS = Layout(brick=8, shard=16, coarsest=8**3)  # so that there are levels of 61, 31, 16 and 8 voxels


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("volumes") / "head.nrrd"
    write_volume(path, *make_phantom("head", size=SIZE))
    return path


@pytest.fixture(scope="module")
def store(source: Path) -> Path:
    out = source.with_suffix(".zarr")
    prepare(str(source), out, Options(layout=BRICKS), Silent())
    return out


@pytest.fixture(scope="module")
def unprepared(source: Path) -> Iterator[SingleProcess]:
    with SingleProcess(source) as single:
        yield single


@pytest.fixture(scope="module")
def single(store: Path) -> Iterator[SingleProcess]:
    with SingleProcess(store) as single:
        yield single


def at_zoom(renderer: Renderer, zoom: float) -> Scene:
    return msgspec.structs.replace(skin(renderer), view=View(rotation=(0.2, 0.3, 0.1, 0.9), zoom=zoom))


def level_of(refinement: Refinement) -> int:
    assert refinement.outcome is not None
    return refinement.outcome.servers.level


def why(refinement: Refinement) -> str:
    assert refinement.outcome is not None
    return refinement.outcome.servers.why_level


def test_what_is_known_of_it_is_what_is_known_of_its_source(single: SingleProcess, unprepared: SingleProcess) -> None:
    one, other = single.volume, unprepared.volume
    assert (one.survey, one.density_counts, one.strength_counts) == (
        other.survey,
        other.density_counts,
        other.strength_counts,
    )
    assert one.default_scene() == other.default_scene()
    assert one.quantisation(Quantise()) == other.quantisation(Quantise())


@pytest.mark.parametrize("step", [Step.C, Step.F])
def test_level_0_is_drawn_as_the_volume_itself(single: SingleProcess, unprepared: SingleProcess, step: Step) -> None:
    scene = at_zoom(single, 1.3)
    drawn = single.finish(scene, step)
    assert level_of(drawn) == 0 and drawn.image[..., 3].max() > 0
    assert torch.equal(drawn.image, unprepared.render(scene, step))


def test_a_strided_step_is_the_paper_s(single: SingleProcess, unprepared: SingleProcess) -> None:
    scene = msgspec.structs.replace(at_zoom(single, 1.3), refine=Refine(striding=True))
    assert torch.equal(single.render(scene, Step.A), unprepared.render(scene, Step.A))


def test_steps_and_zooms_take_levels(single: SingleProcess) -> None:
    levels = {zoom: [level_of(single.finish(at_zoom(single, zoom), step)) for step in Step] for zoom in (1.0, 0.5, 0.2)}
    assert levels == {1.0: [2, 1, 0, 0, 0, 0, 0], 0.5: [3, 2, 1, 1, 1, 1, 1], 0.2: [3, 3, 2, 2, 2, 2, 2]}

    drawn = single.finish(at_zoom(single, 0.5), Step.F)
    assert why(drawn) == "level 1 of 3: every voxel is the mean of 2 x 2 x 2; the finest that the zoom needs"


@pytest.mark.parametrize("preset", ["ct-skin", "ct-bone", "surfaces", "ct-soft-tissue"])
def test_a_level_is_as_bright_as_the_volume(preset: str, single: SingleProcess, unprepared: SingleProcess) -> None:
    """Where voxels become a pixel in size, so that zooming on takes the level."""
    scene = msgspec.structs.replace(
        preset_scene(preset, single.volume.subject()),
        view=View(rotation=(0.2, 0.3, 0.1, 0.9), zoom=0.5),
        image=Image(width=45, height=45),
    )
    drawn = single.finish(scene, Step.F)
    bright, expected = (float(image[..., :3].mean()) for image in (drawn.image, unprepared.render(scene, Step.F)))
    assert level_of(drawn) == 1
    assert abs(bright - expected) <= LEVEL_BRIGHTNESS * expected


@pytest.mark.parametrize("zoom", [0.5, 0.2])
def test_a_precise_scene_is_drawn_as_the_volume_itself_at_any_zoom(
    single: SingleProcess, unprepared: SingleProcess, zoom: float
) -> None:
    scene = msgspec.structs.replace(at_zoom(single, zoom), reconstruction=Reconstruction(precise=True))
    drawn = single.finish(scene, Step.F)
    assert why(drawn) == "level 0 of 3: the volume itself; the scene is precise"
    assert torch.equal(drawn.image, unprepared.render(scene, Step.F)) and drawn.image[..., 3].max() > 0


def test_a_precise_scene_that_does_not_fit_takes_the_finest_level_that_does(store: Path) -> None:
    with SingleProcess(store, memory=600_000) as single:
        scene = msgspec.structs.replace(at_zoom(single, 0.2), reconstruction=Reconstruction(precise=True))
        drawn = single.finish(scene, Step.F)
        assert level_of(drawn) == 1 and "the finest that fits into 0.6 MiB" in why(drawn)


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_sessions_draw_the_same_bits(store: Path, single: SingleProcess, workers: int) -> None:
    with Session(store, workers=workers) as session:
        assert session.volume == single.volume
        for zoom in (1.3, 0.4):
            for step in (Step.A, Step.F):
                scene = at_zoom(session, zoom)
                drawn = session.finish(scene, step)
                expected = single.finish(scene, step)
                assert torch.equal(drawn.image, expected.image) and drawn.image[..., 3].max() > 0
                assert (level_of(drawn), why(drawn)) == (level_of(expected), why(expected))
        width, height = scene.image.width, scene.image.height
        found = session.probe(scene, width / 2, height / 2)
        assert found == single.probe(scene, width / 2, height / 2) and found is not None


def test_a_probe_answers_with_an_index_of_the_volume(single: SingleProcess, unprepared: SingleProcess) -> None:
    near = at_zoom(single, 0.2)
    single.render(near)
    coarse, fine = (one.probe(near, 48, 40) for one in (single, unprepared))
    assert coarse is not None and fine is not None
    assert max(abs(a - b) for a, b in zip(coarse.index, fine.index, strict=True)) <= 4
    assert all(0 <= n < size for n, size in zip(coarse.index, SIZE, strict=True))


def test_little_memory_takes_a_coarser_level_and_says_so(store: Path) -> None:
    with SingleProcess(store, memory=600_000) as single:
        drawn = single.finish(at_zoom(single, 1.3), Step.F)
        assert level_of(drawn) == 1
        assert "the finest that fits into 0.6 MiB of each server" in why(drawn)


@pytest.mark.parametrize("change", [Quantise(window=(0.0, 900.0)), Quantise(directions="paper")])
def test_other_rules_are_refused_with_the_cure(store: Path, single: SingleProcess, change: Quantise) -> None:
    scene = msgspec.structs.replace(at_zoom(single, 1.0), quantise=change)
    cure = "--window 0,900" if change.directions == "octahedral" else "--directions paper"
    with Session(store, workers=1) as session:
        renderers: list[Renderer] = [single, session]
        for renderer in renderers:
            with pytest.raises(BadInput, match=cure):
                renderer.render(scene)
            with pytest.raises(BadInput, match=cure):
                renderer.probe(scene, 1.0, 1.0)
            assert renderer.render(at_zoom(renderer, 1.0))[..., 3].max() > 0


def test_what_is_lost_of_every_level_is_read_by_others(store: Path) -> None:
    with SingleProcess(store) as single, Session(store, workers=2) as session:
        session.render(at_zoom(session, 1.3))
        processes = [psutil.Process(pid) for pid in session.server_processes]
        next(one for one in processes if is_server(one, "mapshade_server")).kill()
        for zoom in (1.3, 0.4):
            assert torch.equal(session.render(at_zoom(session, zoom)), single.render(at_zoom(single, zoom)))
        wait_until(lambda: any(server.lost and server.handed_over for server in session.servers), "is one lost")
        assert torch.equal(session.render(at_zoom(session, 1.3)), single.render(at_zoom(single, 1.3)))


def test_zooming_out_slowly_keeps_a_level_until_the_next_one_is_well_within_a_pixel(store: Path) -> None:
    opened = open_store(str(store))
    grids = opened.levels
    choice = LevelChoice(grids, {1: [grids[0].box]}, {1: 1 << 40})
    scene = Scene(tables=preset_scene("ct-skin").tables, view=View(zoom=0.45))
    assert choice.base_level(scene).level == 1
    assert choice.base_level(scene, current=0).level == 0
    assert choice.base_level(scene, current=2).level == 1, "never coarser than a pixel"
    far = msgspec.structs.replace(scene, view=View(zoom=0.39))
    assert choice.base_level(far, current=0).level == 1


def test_servers_of_one_host_share_its_memory() -> None:
    assert budgets({2: 800, 3: 800, 4: 600}, {2: "a", 3: "a", 4: "b"}) == {2: 200, 3: 200, 4: 300}


def test_any_box_of_a_level_has_the_packets_of_the_store(store: Path) -> None:
    opened = open_store(str(store))
    box = Box((3, 5, 6), (30, 29, 25))
    [cube], read = stored_sub_cubes(opened, 1, [box], [], given_up=lambda: False)
    assert torch.equal(torch.from_numpy(cube.packets), torch.from_numpy(opened.read(1, box)))
    assert read == box.voxels


def test_reading_is_given_up_between_two_sheets_of_bricks(store: Path) -> None:
    opened = open_store(str(store))
    box = opened.levels[0].box
    looks: list[int] = []

    def given_up() -> bool:
        looks.append(1)
        return len(looks) == 3

    with pytest.raises(GivenUp):
        stored_sub_cubes(opened, 0, [box], [], given_up)
    assert len(looks) == 3 < box.size[2] / opened.brick_size


def test_a_newer_assignment_ends_an_older_one_and_keeps_what_was_read(store: Path) -> None:
    opened, identity = identified_store(str(store))
    boxes = [level.box for level in opened.levels]
    newest = 1
    held = HeldVolume()
    held.superseded = lambda assignment: newest > assignment

    def opens(assignment: int, *levels: int) -> OpenPackets:
        held_levels = [LevelBoxes(level, [boxes[level]]) for level in levels]
        return OpenPackets(assignment, str(store), held_levels, identity)

    (answer,) = held.answers(opens(1, 1, 2))
    assert isinstance(answer.message, VoxelsPacked) and held.packed_bytes == 4 * (boxes[1].voxels + boxes[2].voxels)
    before = held.sub_cubes(2)[0]
    newest = 3
    assert held.answers(opens(2, 0, 1, 2)) == []
    assert len(held.answers(opens(3, 2))) == 1
    assert held.sub_cubes(2) == [before] and held.assignment == 3
    with pytest.raises(BadInput, match="level 1 is not held"):
        held.sub_cubes(1)


def test_levels_and_boxes_that_a_store_lacks_are_refused(store: Path) -> None:
    opened, identity = identified_store(str(store))
    low, (i, j, k) = opened.levels[1].box
    for lacking, cause in (
        (LevelBoxes(len(opened.levels), [Box(low, (1, 1, 1))]), f"there is no level {len(opened.levels)}"),
        (LevelBoxes(1, [Box(low, (i, j, k + 1))]), "beyond the volume"),
    ):
        with pytest.raises(BadInput, match=cause):
            HeldVolume().answers(OpenPackets(1, str(store), [lacking], identity))


def test_who_holds_nothing_of_a_level_refuses_to_count_it(store: Path) -> None:
    _, identity = identified_store(str(store))
    held = HeldVolume()
    held.answers(OpenPackets(1, str(store), [LevelBoxes(0, [])], identity))
    with pytest.raises(BadInput, match="nothing is held here"):
        held.answers(CountHistograms(1, 0.0, 255.0, 1.0))


def measured_from_two_sides(preset: str, numbers: Sequence[int], plain: SingleProcess, store: Path) -> list[Bright]:
    """Levels of a store, of the volume that `plain` draws."""
    sides = (ALONG_AXES[0], OBLIQUE[0])
    with SingleProcess(store) as levels:
        return [measured(preset, number, side, plain, levels) for number in numbers for side in sides]


@pytest.mark.parametrize(
    ("volume", "preset"),
    [
        ("orbital/benzene-homo.cube", "orbital"),
        ("maps/3ek3-2fofc.map.gz", "xray-map"),
        ("maps/3ek3-2fofc.map.gz", "molecules"),
    ],
)
def test_levels_of_what_is_thin_are_as_bright_as_the_volume(
    volume: str, preset: str, shared_data: Path, tmp_path: Path
) -> None:
    """From two sides, where zooming out takes them; and pictures do not jump there."""
    name, out = str(shared_data / volume), tmp_path / "levels.zarr"
    with SingleProcess(name) as plain:
        a_fortieth = plain.volume.description.geometry.box.voxels // 40
        prepare(name, out, Options(layout=Layout(coarsest=a_fortieth)), Silent())
        bright = measured_from_two_sides(preset, (1, 2), plain, out)
    assert max(abs(one.of_volume - 1.0) for one in bright) <= THIN_LEVEL_BRIGHTNESS
    assert max(abs(one.jump) for one in bright) <= 2.0


def test_a_level_of_thick_slices_is_as_bright_as_the_volume(shared_data: Path, tmp_path: Path) -> None:
    """Three times as far apart as pixels: halved with these, they would jump by 3.5/255."""
    name, out = str(shared_data / "nifti" / "CT_pitch.nii.gz"), tmp_path / "levels.zarr"
    with SingleProcess(name) as plain:
        prepare(name, out, Options(), Silent())
        bright = measured_from_two_sides("ct-skin", (1,), plain, out)
    assert open_store(str(out)).levels[1].dims == (88, 124, 58)
    assert max(abs(one.of_volume - 1.0) for one in bright) <= 0.03
    assert max(abs(one.jump) for one in bright) <= 2.0


class Template(NamedTuple):
    plain: SingleProcess
    levels: SingleProcess


@pytest.fixture(scope="module")
def template(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Template]:
    """An MR template of a brain, and its level."""
    with with_levels(shared_data / "nrrd" / "template_T2.nrrd", tmp_path_factory.mktemp("template")) as both:
        yield both


@contextmanager
def with_levels(volume: Path, folder: Path) -> Iterator[Template]:
    out = folder / "levels.zarr"
    prepare(str(volume), out, Options(), Silent())
    with SingleProcess(volume) as plain, SingleProcess(out) as levels:
        yield Template(plain, levels)


@pytest.mark.parametrize("preset", ["mr-t1", "mr-t2", "mr-angio"])
def test_a_level_of_bright_colours_is_as_bright_from_every_side(preset: str, template: Template) -> None:
    """The volume's colours are cut off at white: without regard to that the level would be up to 4 % too bright, and
    by a quarter of the columns by chance from some sides more than from others."""
    sides = [*ALONG_AXES, OBLIQUE[3]]
    bright = [measured(preset, 1, side, template.plain, template.levels) for side in sides]
    assert max(abs(one.of_volume - 1.0) for one in bright) <= 0.025
    assert max(abs(one.jump) for one in bright) <= 2.0


def test_a_level_of_thick_slices_is_as_bright_from_oblique_sides(shared_data: Path, tmp_path: Path) -> None:
    """If its sheets were those that a ray passes most of, others than the volume's, bone would jump by up to 5/255."""
    sides = [OBLIQUE[3], (215.0, -50.0), (220.0, -60.0)]
    with with_levels(shared_data / "nifti" / "CT_pitch.nii.gz", tmp_path) as (plain, levels):
        bright = [measured("ct-bone", 1, side, plain, levels) for side in sides]
    assert max(abs(one.jump) for one in bright) <= 2.0
