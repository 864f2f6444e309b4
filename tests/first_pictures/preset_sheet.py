"""The sheet of presets in docs/howto/presets.md: each on a volume that it is made for.

cd tests && ../.venv/bin/python -m first_pictures.preset_sheet ../docs/pictures/presets.jpg
"""

import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from first_pictures import made_up
from first_pictures.subjects import written_phantom

from support.checkout import SHARED_DATA
from volsplat.client.image.image_file import over_background, write_pixels
from volsplat.client.image.picture_sheet import SheetPicture, picture_sheet
from volsplat.client.memory.array_volume import Volume
from volsplat.client.scene.presets import PRESETS, preset_scene
from volsplat.client.scene.suited import why_unsuited
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.text.errors import BadInput

SIDE = 300  # pixels
PHANTOM_SIDE = 96  # voxels
COLUMNS = 5


def of(values: Any, kind: Kind) -> Volume:
    return Volume(values, spacing=(1, 1, 1), space="LPS", kind=kind.value)


HEAD = "ct_head/cthead_256x256x113.nrrd"
VOLUMES: dict[str, str | Callable[[], Volume]] = {
    "ct-skin": HEAD,
    "ct-bone": HEAD,
    "surfaces": HEAD,
    "ct-soft-tissue": HEAD,
    "ct-lung": lambda: of(made_up.chest(contrast=False), Kind.CT),
    "ct-angio": lambda: of(made_up.chest(contrast=True), Kind.CT),
    "mr-t1": "metaimage/HeadMRVolume.mhd",
    "mr-t2": "nrrd/template_T2.nrrd",
    "mr-angio": lambda: of(made_up.vessels_of_a_head(), Kind.MR),
    "xray-map": "maps/EMD-3001.map",
    "em-map": "maps/EMD-3197.map",
    "difference-map": lambda: of(made_up.differences(), Kind.DIFFERENCE_MAP),
    "labels": "metaimage/frogtissue.mhd",
    "depth-cue": "volvis/tooth_103x94x161_uint8.nhdr",
    "molecules": "sod/sod_density_97x97x116.nhdr",
    "atoms": "protein",
    "orbital": "orbital/benzene-homo.cube",
    "structure-factors": "structure-factors",
    "galaxy": "galaxy/l1448_13co.fits",
    "seismic": "seismic",
}


def volume_of(name: str, folder: Path) -> Path | Volume:
    """A phantom is written first, which states its kind."""
    chosen = VOLUMES[name]
    if not isinstance(chosen, str):
        return chosen()
    return SHARED_DATA / chosen if "/" in chosen else written_phantom(chosen, folder, PHANTOM_SIDE)


def picture(name: str) -> SheetPicture:
    """In the view that its scene starts with."""
    with TemporaryDirectory() as folder, SingleProcess(volume_of(name, Path(folder)), threads=2) as single:
        subject = single.volume.subject()
        scene = preset_scene(name, subject).with_(size=SIDE)
        pixels = over_background(single.finish(scene).published.pixels, scene.image.background)
        return SheetPicture(pixels, "", name, note=why_unsuited(name, subject) or "")


if __name__ == "__main__":
    if not SHARED_DATA.is_dir():
        raise SystemExit(f"{SHARED_DATA}: the real volumes are not here")
    if missing := PRESETS.keys() - VOLUMES.keys():
        raise SystemExit(f"{', '.join(missing)}: no volume is named for it; name one in {Path(__file__).name}")
    try:
        write_pixels(Path(sys.argv[1]), picture_sheet([picture(name) for name in PRESETS], COLUMNS))
    except BadInput as error:
        raise SystemExit(str(error)) from None
