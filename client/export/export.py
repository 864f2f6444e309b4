"""Which kinds of file there are to export to, and which one a name asks for."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from volsplat.client.export.gaussians import write_gaussians
from volsplat.client.export.local_origin import NOWHERE_ELSE, local_origin, origin_text
from volsplat.client.export.mesh import need_mesh, write_mesh
from volsplat.client.export.view_light import Light
from volsplat.client.image.image_formats import check_place
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import VolumeDescription
from volsplat.protocol.text.errors import BadInput

CLOUD = ".ply"
MESHES = (".stl", ".glb", ".obj")
SUFFIXES = (CLOUD, *MESHES)


def check_export(path: Path, level: float | None, light: Light | None) -> None:
    """Raises BadInput before any work if no such file can be written."""
    kind = path.suffix.lower()
    if kind not in SUFFIXES:
        raise BadInput(f"{path}: end the name in .ply for Gaussians, or in .stl, .glb or .obj for a mesh")
    if kind == CLOUD and level is not None:
        raise BadInput(f"{path}: --level is for a mesh; end the name in {', '.join(MESHES)}, or leave it out")
    if kind != CLOUD and light is not None:
        raise BadInput(f"{path}: a mesh has no light of its own; leave out --light, or end the name in {CLOUD}")
    check_place(path)
    if kind != CLOUD:
        need_mesh()


def write_export(
    single: SingleProcess,
    scene: Scene,
    path: Path,
    level: float | None,
    every: int,
    light: Light | None,
    on_progress: Callable[[float], None] = lambda share: None,
) -> str:
    """Write the file that the name's ending asks for; says what it holds. Raises BadInput."""
    check_export(path, level, light)
    if path.suffix.lower() == CLOUD:
        count = write_gaussians(single, scene, path, every, light or "viewer", on_progress)
        return f"{count} Gaussians{_place_note(path, single)}"
    check_has_surface(single.volume.description)
    written = write_mesh(single, scene, path, level, every, on_progress)
    unit = f" {single.volume.description.value_unit}".rstrip()
    return f"{written.triangles} triangles at {written.level:.6g}{unit}{_place_note(path, single)}"


def check_has_surface(told: VolumeDescription) -> None:
    """Raises BadInput if no value lies between those of the voxels. Labels have the outline of what is labelled."""
    if told.kind is Kind.ELEMENTS:
        raise BadInput(
            f"a mesh is where values pass a level, but {told.name} holds elements, no more or less than others; export "
            "Gaussians (.ply), or #density of atoms in a file"
        )


def _place_note(path: Path, single: SingleProcess) -> str:
    """Where the file's own origin lies, if that is not the volume's."""
    geometry = single.volume.description.geometry
    local = local_origin(geometry)
    if path.suffix.lower() in (".glb", ".obj") or local == NOWHERE_ELSE:  # .glb says so itself, .obj has all digits
        return ""
    return f", counted from {origin_text(local, geometry.spacing)}: from 0, float32 would not keep voxels apart"
