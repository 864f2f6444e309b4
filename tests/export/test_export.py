"""Exported files: Gaussians that draw our picture again, and meshes that are the surface, right side out."""

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import plyfile
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import volsplat as vs
from support.programs.programs import Person
from tolerances import CLOUD_LEVELS, MESH_VOLUME
from volsplat.client.export.export import check_export, write_export
from volsplat.client.export.gaussians import ellipsoid
from volsplat.client.export.mesh import edge_of_table
from volsplat.client.export.view_light import HARMONICS, Light, harmonics
from volsplat.client.memory.array_volume import Volume
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.geometry import matrices
from volsplat.protocol.rules.footprint_shape import GAUSSIAN_SIGMA
from volsplat.protocol.rules.resolved_view import screen_rotation
from volsplat.protocol.text.errors import BadInput

SKEW = np.array([[1.0, 0.3, 0.0, 5.0], [0.0, 1.2, 0.0, -3.0], [0.0, 0.1, 0.9, 2.0], [0.0, 0.0, 0.0, 1.0]])
MIRRORED = np.diag([-1.0, 1.0, 1.0, 1.0]) @ SKEW
RADIUS = 8.0  # voxels


def ball(affine: NDArray[np.float64]) -> Volume:
    """Values fall from 255 through 128 at RADIUS voxels from the middle."""
    z, y, x = np.mgrid[-12:13, -12:13, -12:13]
    away = np.sqrt(x**2 + y**2 + z**2)
    return Volume((128.0 + 24.0 * (RADIUS - away)).clip(0, 255).astype(np.uint8), affine=affine)


def rotation_of(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    w, x, y, z = quaternion
    return np.array(matrices.rotation_from_quaternion((x, y, z, w)))


@given(st.lists(st.floats(-3, 3), min_size=9, max_size=9))
def test_a_gaussian_has_the_shape_of_its_voxel(entries: list[float]) -> None:
    to_physical = np.array(entries).reshape(3, 3)
    to_physical += 4.0 * np.diag([1.0 if entry >= 0.0 else -1.0 for entry in np.diag(to_physical)])
    scales, quaternion = ellipsoid(to_physical)
    turned = rotation_of(quaternion)
    covariance = turned @ np.diag(scales**2) @ turned.T
    assert np.allclose(covariance, GAUSSIAN_SIGMA**2 * to_physical @ to_physical.T)
    assert math.isclose(float(quaternion @ quaternion), 1.0)


def test_the_light_s_harmonics_are_orthonormal() -> None:
    heights, weights = np.polynomial.legendre.leggauss(8)
    around = np.arange(16) * math.pi / 8
    z, azimuth = (grid.ravel() for grid in np.meshgrid(heights, around, indexing="ij"))
    flat = np.sqrt(1.0 - z * z)
    values = harmonics(np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), z], axis=-1))
    over_the_sphere = np.repeat(weights, len(around))[:, None] * math.pi / 8
    assert np.allclose(values.T @ (over_the_sphere * values), np.eye(HARMONICS))


def drawn(path: Path, single: SingleProcess, scene: Scene) -> NDArray[np.float64]:
    """The file as a viewer of Gaussians draws it, from the scene's view: (H, W, 4), associated alpha."""
    vertex = plyfile.PlyData.read(path)["vertex"]
    settled = single.volume.settled(scene)
    assert settled.view.zoom != "fit" and settled.view.center != "middle"
    geometry = single.volume.description.geometry
    to_pixels = np.array(screen_rotation(settled.view)) * settled.view.zoom / geometry.reference_spacing
    place = np.stack([vertex[name] for name in "xyz"], axis=-1) - geometry.physical(settled.view.center)
    x, y, depth = (place @ to_pixels.T).T
    width, height = scene.image.width, scene.image.height
    alpha = 1.0 / (1.0 + np.exp(-vertex["opacity"].astype(np.float64)))
    of_view = harmonics(-np.array(screen_rotation(settled.view))[2:])[0]
    bands = (len([name for name in vertex.data.dtype.names if name.startswith("f_rest")])) // 3
    of_channels = [[f"f_dc_{n}", *(f"f_rest_{bands * n + k}" for k in range(bands))] for n in range(3)]
    colour = np.stack([of_view[: bands + 1] @ [vertex[name] for name in names] for names in of_channels], axis=-1) + 0.5
    turned = rotation_of(np.array([vertex[f"rot_{n}"][0] for n in range(4)], dtype=np.float64))
    axes = to_pixels @ turned * np.exp([vertex[f"scale_{n}"][0] for n in range(3)])
    inverse = np.linalg.inv((axes @ axes.T)[:2, :2])
    rows, columns = np.mgrid[:height, :width]
    image = np.zeros((height, width, 4))
    for n in np.argsort(depth):
        aside = np.stack([columns - (width - 1) / 2 - x[n], (height - 1) / 2 - rows - y[n]], axis=-1)
        weight = alpha[n] * np.exp(-0.5 * np.einsum("hwa,ab,hwb->hw", aside, inverse, aside))[..., None]
        image = image * (1.0 - weight) + weight * np.append(colour[n], 1.0)
    return image


@pytest.mark.parametrize("affine", [np.eye(4), MIRRORED], ids=["even", "mirrored and skew"])
def test_gaussians_draw_our_picture_again(affine: NDArray[np.float64], tmp_path: Path) -> None:
    with SingleProcess(ball(affine)) as single:
        scene = single.volume.default_scene().with_(size=(32, 32), rotation=(30, 20))
        behind = scene.with_(rotation=(-140, 20))
        ways: list[tuple[Light, Scene]] = [("scene", scene), ("viewer", scene), ("viewer", behind)]
        for light, seen in ways:
            said = write_export(single, scene, tmp_path / "ball.ply", level=None, every=1, light=light)
            picture = single.finish(seen).published.pixels
            again = drawn(tmp_path / "ball.ply", single, seen)
            assert picture[..., 3].max() > 0.5
            assert np.abs(again - picture).mean() < CLOUD_LEVELS
            mirrored = np.abs(again[:, ::-1] - picture).mean()
            assert mirrored > 1.5 * CLOUD_LEVELS, "lit from one side, so that it can be told"
        assert said == f"{plyfile.PlyData.read(tmp_path / 'ball.ply')['vertex'].count} Gaussians"


@pytest.mark.parametrize("affine", [np.eye(4), SKEW, MIRRORED], ids=["even", "skew", "mirrored and skew"])
def test_a_mesh_is_the_surface_right_side_out(affine: NDArray[np.float64], tmp_path: Path) -> None:
    import trimesh  # for a second, which all who collect this need not take

    expected = 4 / 3 * math.pi * RADIUS**3 * abs(np.linalg.det(affine))
    with SingleProcess(ball(affine)) as single:
        scene = single.volume.default_scene()
        for kind in (".stl", ".glb", ".obj"):
            write_export(single, scene, tmp_path / f"ball{kind}", level=128.0, every=1, light=None)
            mesh: Any = trimesh.load(tmp_path / f"ball{kind}", force="mesh")
            assert mesh.is_watertight
            assert mesh.volume == pytest.approx(expected, rel=MESH_VOLUME)
            middle = affine[:3, :3] @ [12, 12, 12] + affine[:3, 3]
            assert np.allclose(mesh.center_mass, middle, atol=0.1)
        cut = scene.with_(bounds=((0, 0, 0), (13, 25, 25)))
        write_export(single, cut, tmp_path / "half.stl", level=128.0, every=1, light=None)
        half: Any = trimesh.load(tmp_path / "half.stl", force="mesh")
        assert half.is_watertight and half.volume == pytest.approx(expected / 2, rel=MESH_VOLUME)
        assert 0.0 < edge_of_table(scene) < 255.0


def test_far_from_the_origin_voxels_are_kept_apart(tmp_path: Path) -> None:
    import trimesh

    far = np.array([5e5, 5.3e6, 100.0])
    affine = np.diag([0.1, 0.1, 0.1, 1.0])
    affine[:3, 3] = far
    with SingleProcess(ball(affine)) as single:
        scene = single.volume.default_scene()
        told = {
            kind: write_export(single, scene, tmp_path / f"ball{kind}", None, 1, None)
            for kind in (".ply", ".stl", ".glb", ".obj")
        }
    assert all(
        ("counted from 500000.0000, 5300000.0000, 100.0000" in told[kind]) == (kind in ".ply .stl") for kind in told
    )
    cloud = plyfile.PlyData.read(str(tmp_path / "ball.ply"))
    assert any("counted from 500000.0000, 5300000.0000, 100.0000" in line for line in cloud.comments)
    steps = np.array([cloud["vertex"][axis] for axis in "xyz"]) / 0.1
    assert np.abs(steps - np.round(steps)).max() < 0.01
    for kind, origin in ((".stl", (0.0, 0.0, 0.0)), (".glb", far), (".obj", far)):
        mesh: Any = trimesh.load(tmp_path / f"ball{kind}", force="mesh")
        assert mesh.bounds.mean(axis=0) - origin == pytest.approx([1.2] * 3, abs=0.01)
        assert mesh.extents == pytest.approx(np.repeat(mesh.extents.mean(), 3), abs=0.01)


def test_a_mesh_of_nanometres_in_metres_keeps_its_shape(tmp_path: Path) -> None:
    for name, unit in (("tiny", 5e-9), ("usual", 1.0)):
        with SingleProcess(ball(np.diag([unit, unit, unit, 1.0]))) as single:
            for kind in (".stl", ".obj"):
                write_export(
                    single, single.volume.default_scene(), tmp_path / f"{name}{kind}", level=128.0, every=1, light=None
                )
    lines = [(tmp_path / f"{name}.obj").read_text("utf-8").splitlines() for name in ("tiny", "usual")]
    tiny, usual = (np.array([line.split()[1:4] for line in of_one if line[:2] == "v "]) for of_one in lines)
    assert np.allclose(tiny.astype(float) / 5e-9, usual.astype(float), atol=1e-3)
    triangle = np.dtype([("normal", "<3f4"), ("corners", "<9f4"), ("attribute", "<u2")])
    normals = np.frombuffer((tmp_path / "tiny.stl").read_bytes()[84:], triangle)["normal"]
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-4)


def test_elements_have_no_surface_but_their_density_has_one(tmp_path: Path) -> None:
    (tmp_path / "two.pdb").write_text(
        "ATOM      1  CA  GLY A   1       1.000   2.000   3.000  1.00 10.00           C\n"
        "ATOM      2  N   GLY A   1       2.400   2.000   3.000  1.00 10.00           N\nEND\n"
    )
    refusal = r"two\.pdb holds elements, .*export Gaussians \(\.ply\), or #density of atoms in a file"
    for level in (None, 0.83):
        with pytest.raises(BadInput, match=refusal):
            vs.export(str(tmp_path / "two.pdb"), str(tmp_path / "two.stl"), level=level)
    assert vs.export(str(tmp_path / "two.pdb#density"), str(tmp_path / "two.stl")).split()[1] == "triangles"
    vs.export(str(tmp_path / "two.pdb"), str(tmp_path / "two.ply"))


def test_colours_of_a_glb_are_linear(tmp_path: Path) -> None:
    import trimesh

    with SingleProcess(ball(np.eye(4))) as single:
        scene = single.volume.default_scene()
        for kind in (".glb", ".obj"):
            write_export(single, scene, tmp_path / f"ball{kind}", level=128.0, every=1, light=None)
    meshes: list[Any] = [trimesh.load(tmp_path / f"ball{kind}", force="mesh") for kind in (".glb", ".obj")]
    stored, shown = (mesh.visual.vertex_colors[0, :3] / 255 for mesh in meshes)
    assert shown.max() > 0.2 and np.allclose(stored, ((shown + 0.055) / 1.055) ** 2.4, atol=0.02)


def test_what_cannot_be_exported_is_one_line_and_leaves_what_was_there(tmp_path: Path) -> None:
    person = Person(tmp_path)
    z, y, x = np.mgrid[-6:7, -6:7, -6:7]
    np.save(tmp_path / "ball.npy", (200 - 20 * np.sqrt(x**2 + y**2 + z**2)).clip(0).astype(np.uint8))
    (tmp_path / "ball.stl").write_text("before")
    for options, words in {
        "ball.plyy": "end the name in .ply for Gaussians",
        "ball.stl --level 9000 --preset difference-map": "widen --window",
    }.items():
        answer = person.runs("export", "ball.npy", "-o", *options.split())
        assert answer.returncode == 2 and words in answer.stderr.splitlines()[-1], answer.stderr
    assert "note: " in answer.stderr and "both sides of 0" in answer.stderr, "as render says of such a preset"
    refused: list[tuple[str, float | None, Light | None, str]] = [
        ("ball.ply", 3.0, None, "--level is for a mesh"),
        ("ball.stl", None, "even", "leave out --light"),
        ("away/ball.stl", None, None, "make it first"),
    ]
    for path, level, light, words in refused:
        with pytest.raises(BadInput, match=words):
            check_export(tmp_path / path, level, light)
    assert (tmp_path / "ball.stl").read_text(encoding="utf-8") == "before"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ball.npy", "ball.stl"]


def test_a_missing_library_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "trimesh", None)
    cure = r"a mesh needs trimesh, which is not installed: pip install 'volsplat\[export\]'"
    with pytest.raises(BadInput, match=cure):
        vs.export(ball(np.eye(4)), tmp_path / "ball.glb")
    assert not any(tmp_path.iterdir())
    assert vs.export(ball(np.eye(4)), tmp_path / "ball.ply").endswith(" Gaussians"), "which needs no extra"


def test_scripts_export_through_the_front_door(tmp_path: Path) -> None:
    volume = ball(np.eye(4))
    every, fewer = (vs.export(volume, tmp_path / f"{n}.ply", "depth-cue", every=n, light="even") for n in (1, 2))
    assert int(every.split()[0]) > 4 * int(fewer.split()[0])
    assert vs.export(volume, str(tmp_path / "ball.stl"), level=128).endswith(" triangles at 128")
    with SingleProcess(volume) as single:
        vs.export(single, tmp_path / "again.ply", "depth-cue", light="even")
    assert (tmp_path / "again.ply").read_bytes() == (tmp_path / "1.ply").read_bytes()
    with pytest.raises(BadInput, match="light must be viewer, scene or even, not 'sun'"):
        vs.export(volume, tmp_path / "sun.ply", light="sun")  # type: ignore[arg-type]
    with vs.open(volume, workers=1) as session, pytest.raises(BadInput, match="give export the volume itself"):
        vs.export(session, tmp_path / "session.ply")


def test_a_fault_of_marching_cubes_is_not_taken_for_an_empty_volume(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: Any, **__: Any) -> None:
        raise RuntimeError("out of cells")

    monkeypatch.setattr("skimage.measure.marching_cubes", fails)
    with pytest.raises(RuntimeError, match="out of cells"):
        vs.export(ball(np.eye(4)), tmp_path / "ball.stl", level=128)
    assert not any(tmp_path.iterdir())
