"""The shading kernel against the reference: powers, light, opacity codes, and whole frames of shaded packets."""

import math
import os
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor
from torch.utils.dlpack import from_dlpack

from reference import mapping, shading, voxel_packets
from support.scenes.arbitrary import geometries, plain_scene
from support.scenes.shaded_packets import Packets, all_batches, packets_of
from support.scenes.shadings import directions, quantisations, scalar_tables, shaded_scenes, volumes
from tolerances import CODE_TIE, FLOAT32_COLOUR, MEAN_LIGHT, POWER
from volsplat.bench.floors.cpu_paths import kernels_on
from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.frames import shading_tables
from volsplat.mapshade_server.frames.frame_walk import FrameWalk
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.mapshade_server.links.shaded_part import parts_of
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.shading_tables import ScalarTable
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.rules.frame_plan import FramePlan, plan_frame
from volsplat.protocol.rules.index_rules import (
    FIRST_TWO_FACED,
    OF_FACING,
    ROUGH_DIRECTIONS,
    ROUGHNESS_COSINES,
    ROUGHNESSES,
    TWO_FACED_DIRECTIONS,
    Quantisation,
)
from volsplat.protocol.rules.packet_layout import OPACITY_UNIT, code_of_opacity
from volsplat.protocol.rules.refinement import PAPER_STEPS
from volsplat.protocol.rules.resolved_view import screen_rotation
from volsplat.protocol.rules.shading_rule import shading_rule
from volsplat.protocol.text.errors import BadInput

HALF = 0.5
CPU_FLAGS = {"avx2": {"avx2", "bmi2"}, "avx512": {"avx512f", "avx512bw", "avx512vl", "avx512dq"}}


def shaded(geometry: Geometry, values: Tensor, quantisation: Quantisation, scene: Scene, plan: FramePlan) -> Packets:
    sub_cube = SubCube.of_volume(geometry, values)
    sub_cube.pack(quantisation)
    return packets_of(all_batches(FrameWalk([sub_cube], Drawing.of(scene, plan, geometry, quantisation))))


@given(data=st.data(), geometry=geometries(), quantisation=quantisations(), step=st.sampled_from(PAPER_STEPS))
def test_a_frame_holds_what_the_reference_shades(
    data: st.DataObject, geometry: Geometry, quantisation: Quantisation, step: Step
) -> None:
    scene = data.draw(shaded_scenes(geometry))
    values = data.draw(volumes(geometry))
    plan = plan_frame(scene, geometry, step)
    packets = voxel_packets.pack(values, geometry, quantisation)
    samples = mapping.samples_of(scene, geometry, plan)
    i, j, k = samples.indices.unbind(1)
    here = packets[k, j, i]
    fields = shading.field_bytes(plan, geometry, quantisation.directions, samples.indices, here)
    vectors = voxel_packets.directions(quantisation.directions)
    exponent = shading.opacity_exponents(plan, samples.indices)
    colour, opacity = shading.shade(here, fields, scene, step, exponent, vectors)
    sent = shading.opacity_codes(opacity) > 0

    got = shaded(geometry, values, quantisation, scene, plan)
    assert torch.equal(got.keys, samples.ordinals[sent, :2])
    assert torch.equal(got.position, samples.lattice[sent])
    assert_opacity_codes_are_nearest(got.opacity, opacity[sent])
    assert ((got.colour - 255 * colour[sent]).abs() <= HALF + FLOAT32_COLOUR).all()


def assert_opacity_codes_are_nearest(codes: Tensor, opacity: Tensor) -> None:
    values = shading.opacity_values()
    edges = torch.cat((torch.zeros(1), (values[1:] + values[:-1]) / 2, torch.ones(1)))
    tie = CODE_TIE / OPACITY_UNIT
    assert ((edges[codes] - tie <= opacity) & (opacity <= edges[codes + 1] + tie)).all()


@given(data=st.data(), geometry=geometries(largest=40), quantisation=quantisations(), step=st.sampled_from(PAPER_STEPS))
def test_every_cpu_path_gives_the_same_bits(
    data: st.DataObject, geometry: Geometry, quantisation: Quantisation, step: Step
) -> None:
    scene = data.draw(shaded_scenes(geometry))
    values = data.draw(volumes(geometry))
    plan = plan_frame(scene, geometry, step)
    frames = []
    for path in _kernels.cpu_paths():
        with kernels_on(_kernels, path):
            sub_cube = SubCube.of_volume(geometry, values)
            sub_cube.pack(quantisation)
            batches = all_batches(FrameWalk([sub_cube], Drawing.of(scene, plan, geometry, quantisation)))
            frames.append([(bytes(part.runs), bytes(part.packets)) for batch in batches for part in parts_of(batch)])
    assert all(frame == frames[0] for frame in frames)


@given(data=st.data(), geometry=geometries())
def test_voxels_without_data_are_never_drawn(data: st.DataObject, geometry: Geometry) -> None:
    values = data.draw(volumes(geometry))
    all_seen = plain_scene(size=(8192, 8192), view=data.draw(shaded_scenes(geometry)).view)
    tables = all_seen.tables
    opaque = type(tables)(emit=tables.emit, refl=tables.refl, opac=ScalarTable(points=((0.0, 1.0),)))
    scene = type(all_seen)(tables=opaque, view=all_seen.view, image=all_seen.image)
    quantisation = Quantisation(window=(-2.0, 2.0), strength_scale=1.0)
    got = shaded(geometry, values, quantisation, scene, plan_frame(scene, geometry, Step.F))
    assert len(got.opacity) == int(torch.isfinite(values).sum())


@given(base=st.floats(0, 1), exponent=st.floats(1e-6, 1000))
def test_powers_are_accurate(base: float, exponent: float) -> None:
    assert _kernels.power(base, exponent) == pytest.approx(math.pow(base, exponent), rel=POWER, abs=sys.float_info.min)


@given(opac=scalar_tables(), modu=scalar_tables(), exponent=st.sampled_from((1.0, 2.0, 4.0)) | st.floats(1e-3, 500))
def test_opacity_tables_are_those_of_the_reference(opac: ScalarTable, modu: ScalarTable, exponent: float) -> None:
    codes = from_dlpack(_kernels.opacity_table(opac.entries(), modu.entries(), exponent)).to(torch.int64)
    opac_entries, modu_entries = (torch.tensor(t.entries(), dtype=torch.float64) for t in (opac, modu))
    thin = (modu_entries[:, None] * opac_entries).flatten()
    opacity = shading.thickened(thin, torch.tensor(exponent, dtype=torch.float64))
    assert_opacity_codes_are_nearest(codes, opacity)


@given(opacities=st.lists(st.floats(0, 1), min_size=1, max_size=256))
def test_opacities_are_coded_by_the_rule_of_the_packet_layout(opacities: list[float]) -> None:
    table = opacities + [0.0] * (256 - len(opacities))
    codes = from_dlpack(_kernels.opacity_table(table, [1.0] * 256, 1.0))[:256]
    assert codes.tolist() == [code_of_opacity(opacity) for opacity in table]


@given(data=st.data(), geometry=geometries(), scheme=directions, step=st.sampled_from(PAPER_STEPS))
def test_light_tables_are_those_of_the_reference(
    data: st.DataObject, geometry: Geometry, scheme: str, step: Step
) -> None:
    scene = data.draw(shaded_scenes(geometry))
    lighting = shading_rule(scene, step).lighting
    expected = shading.light_of_directions(scene, step, voxel_packets.directions(scheme))
    for path in _kernels.cpu_paths():
        with kernels_on(_kernels, path):
            table = from_dlpack(shading_tables.light_of_directions(lighting, scheme))
        assert ((table - expected).abs() * 255 <= FLOAT32_COLOUR).all()


@given(data=st.data(), geometry=geometries())
def test_light_on_rough_directions_is_the_mean_around_them(data: st.DataObject, geometry: Geometry) -> None:
    scene = data.draw(shaded_scenes(geometry))
    scene = msgspec.structs.replace(scene, shading=msgspec.structs.replace(scene.shading, specular=False))
    table = from_dlpack(shading_tables.light_of_directions(shading_rule(scene, Step.F).lighting, "rough"))
    sparse = voxel_packets.directions("rough")[: ROUGHNESSES * ROUGH_DIRECTIONS : 101]
    upright = torch.where(sparse[:, :1].abs() < 0.9, torch.tensor([[1.0, 0.0, 0.0]]), torch.tensor([[0.0, 1.0, 0.0]]))
    aside = torch.nn.functional.normalize(torch.linalg.cross(sparse, upright.double()), dim=1)
    third = torch.linalg.cross(sparse, aside)
    cosines = torch.tensor(ROUGHNESS_COSINES, dtype=torch.float64)[
        torch.arange(0, ROUGHNESSES * ROUGH_DIRECTIONS, 101) // ROUGH_DIRECTIONS
    ]
    expected = torch.zeros(len(sparse), dtype=torch.float64)
    for cosine in cosines.T[:, :, None]:
        for around in torch.arange(0.5, 16) * math.pi / 8:
            ring = aside * around.cos() + third * around.sin()
            direction = sparse * cosine + ring * (1 - cosine**2).sqrt()
            expected += shading.light_of_directions(scene, Step.F, direction) / (8 * 16)
    assert (table[: ROUGHNESSES * ROUGH_DIRECTIONS : 101] - expected).abs().max() <= MEAN_LIGHT


@given(data=st.data(), geometry=geometries())
def test_light_falls_on_both_faces_and_is_seen_of_either_as_far_as_it_faces_the_viewer(
    data: st.DataObject, geometry: Geometry
) -> None:
    scene = data.draw(shaded_scenes(geometry))
    table = from_dlpack(shading_tables.light_of_directions(shading_rule(scene, Step.F).lighting, "rough"))
    codes = slice(FIRST_TWO_FACED, FIRST_TWO_FACED + TWO_FACED_DIRECTIONS)
    one = voxel_packets.directions("rough")[codes]
    eye = torch.tensor(matrices.applied(matrices.transposed(screen_rotation(scene.view)), (0.0, 0.0, 1.0))).double()
    expected = sum(
        (1 - OF_FACING * face @ eye) / 2 * shading.light_of_directions(scene, Step.F, face) for face in (one, -one)
    )
    assert ((table[codes] - expected).abs() * 255 <= FLOAT32_COLOUR).all()


def test_tables_are_kept_while_the_scene_stays_the_same() -> None:
    rules = [shading_tables.opacity_rule(shading_rule(plain_scene(opacity=0.3), Step.F)) for _ in range(2)]
    assert shading_tables.opacity_codes(rules[0], 2.0) is shading_tables.opacity_codes(rules[1], 2.0)


def test_a_cpu_path_that_does_not_exist_is_refused_with_those_that_do() -> None:
    with pytest.raises(BadInput, match=r'"sse9".*baseline'):
        _kernels.set_cpu_path("sse9")


def test_the_environment_chooses_the_cpu_path() -> None:
    assert path_in_a_new_process("baseline").stdout == "baseline\n"


def test_a_cpu_path_of_the_environment_that_does_not_exist_is_refused() -> None:
    refused = path_in_a_new_process("fastest")
    assert refused.returncode != 0
    assert 'VOLSPLAT_CPU_PATH asks for the CPU path "fastest"' in refused.stderr.splitlines()[-1]


def path_in_a_new_process(path: str) -> subprocess.CompletedProcess[str]:
    program = "from volsplat.mapshade_server import _kernels; print(_kernels.cpu_path())"
    return subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "VOLSPLAT_CPU_PATH": path},
        capture_output=True,
        encoding="utf-8",
        check=False,
    )


def test_every_path_that_this_cpu_can_run_is_built() -> None:
    info = Path("/proc/cpuinfo")
    if not info.exists():
        pytest.skip("this system has no /proc/cpuinfo to tell what the CPU can do")
    flags = set(info.read_text(encoding="utf-8").split())
    able = {path for path, needed in CPU_FLAGS.items() if needed <= flags}
    assert set(_kernels.cpu_paths()) == {"baseline"} | able
