"""First pictures by volsplat and by other tools: lines to write, seconds to wait, and what comes out.

    cd tests && ../.venv/bin/python -m first_pictures.peers ENVIRONMENTS OUT [TOOL ...]

Each tool of PyPI gets an environment of its own below ENVIRONMENTS, which pip fills; ParaView is Debian's `pvpython`.
OUT gets a picture for each kind of volume, FOUND.md and SHEET.png; it keeps what other tools came to in a run before.
Pictures are drawn on the screen of `xvfb-run`. Run it twice, and let nothing else run meanwhile: the first run fills
caches of files and of compiled Python.
"""

import os
import resource
import shutil
import signal
import subprocess
import sys
import time
import venv
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
import OpenImageIO as oiio
from first_pictures.peer_scripts import TOOLS, Tool
from numpy.typing import NDArray

from support.checkout import SHARED_DATA
from support.files.opened import read_whole
from volsplat.client.image.image_file import write_pixels
from volsplat.client.image.picture_sheet import SheetPicture, picture_sheet

VOLUMES = {
    "CT, NIfTI": "nifti/CT_pitch.nii.gz",
    "CT, DICOM": "dicom_ct_phantom",
    "array, NumPy": "ct_head/cthead_256x256x113.nrrd",
    "map, MRC": "maps/EMD-3197.map",
    "cube, FITS": "galaxy/ngc6946.fits",
}
LIMIT = 300.0  # seconds for one picture
TIMES = 1  # the first fills caches of files and of compiled Python; the least counts
SIDE = 300


class Drawn(NamedTuple):
    lines: int = 0
    seconds: float = 0.0
    processor: float = 0.0  # seconds, of all cores together
    picture: str = ""  # its file
    said: str = "no reader"  # why there is no picture


def environment(name: str, tool: Tool, folder: Path) -> Path | None:
    """Where the tool's program is; None where it is not installed."""
    if not tool.packages:
        own = Path(sys.executable) if tool.program == "python" else shutil.which(tool.program)
        return Path(own) if own else None
    place = folder / name
    if not (place / "installed").exists():
        venv.create(place, with_pip=True, clear=True)
        subprocess.run([place / "bin/python", "-m", "pip", "install", "--quiet", *tool.packages], check=True)
        (place / "installed").touch()
    return place / "bin/python"


def drawn(program: Path, script: str, volume: Path, picture: Path, in_notebook: bool) -> Drawn:
    """From the start of the program to its end, with the picture in a file."""
    lines = len(script.splitlines())
    text = script.replace("FILE", str(volume)).replace("PICTURE", str(picture))
    picture.with_suffix(".py").write_text(text)
    command = [str(program), str(picture.with_suffix(".py"))]
    if in_notebook:
        command = [sys.executable, "-m", "first_pictures.notebook_peer", *command, str(picture)]
    elif shutil.which("xvfb-run"):
        command = ["xvfb-run", "-a", *command]
    picture.unlink(missing_ok=True)
    began, used = time.perf_counter(), processor_seconds()
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command, stdout=pipe, stderr=pipe, encoding="utf-8", errors="replace", start_new_session=True
    ) as running:
        try:
            out, errors = running.communicate(timeout=LIMIT)
        except subprocess.TimeoutExpired:
            os.killpg(running.pid, signal.SIGKILL)  # with the screen or the notebook's server that it started
            return Drawn(lines, LIMIT, said=f"not in {LIMIT:.0f} s")
    taken = (lines, time.perf_counter() - began, processor_seconds() - used)
    if running.returncode != 0 or not picture.exists():
        said = (errors or out).strip().splitlines()
        return Drawn(*taken, said=said[-1] if said else f"ended with status {running.returncode}")
    return Drawn(*taken, str(picture), "")


def processor_seconds() -> float:
    """Of all programs that have been waited for."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def given(kind: str, folder: Path) -> Path:
    """The volume's file; for an array, the one that scripts load; a map has the ending that all tools know."""
    source = SHARED_DATA / VOLUMES[kind]
    if kind == "array, NumPy":
        np.save(folder / "array.npy", read_whole(source))
        return folder / "array.npy"
    return shutil.copyfile(source, folder / "map.mrc") if kind == "map, MRC" else source


def shown(tool: str, one: Drawn) -> SheetPicture:
    if not one.picture:
        return SheetPicture(np.zeros((SIDE, SIDE, 3), np.float32), "", tool, note=one.said)
    image = oiio.ImageBufAlgo.channels(oiio.ImageBuf(one.picture), (0, 1, 2))
    square = oiio.ImageBufAlgo.fit(image, roi=oiio.ROI(0, SIDE, 0, SIDE, 0, 1, 0, 3))
    pixels: NDArray[np.float32] | None = square.get_pixels(oiio.FLOAT)
    assert pixels is not None, square.geterror()
    return SheetPicture(np.clip(pixels, 0, 1), "", tool, f"{one.lines} lines, {one.processor:.1f} s of processor time")


def measure(environments: Path, out: Path, name: str) -> None:
    tool, found = TOOLS[name], {}
    program = environment(name, tool, environments)
    if program is None:
        print(f"{name}: {tool.program} is not installed; left out")
        return
    for kind in VOLUMES:
        one = Drawn()
        if script := tool.scripts.get(kind):
            picture = out / f"{kind.replace(', ', '-')}-{name}.png"
            one = drawn(program, script, given(kind, out), picture, tool.in_notebook)
        print(f"{name}, {kind}: {one.lines} lines, {one.seconds:.1f} s {one.said}", flush=True)
        found[kind] = one
    (out / f"{name}.json").write_bytes(msgspec.json.encode(found))


def report(out: Path) -> None:
    known = {
        name: msgspec.json.decode((out / f"{name}.json").read_bytes(), type=dict[str, Drawn])
        for name in TOOLS
        if (out / f"{name}.json").exists()
    }
    rows = [f"| lines, seconds, processor seconds | {' | '.join(known)} |", "|---" * (len(known) + 1) + "|"]
    for kind in VOLUMES:
        all_found = [found[kind] for found in known.values()]
        cells = [f"{one.lines}, {one.seconds:.1f}, {one.processor:.1f}" if one.picture else "no" for one in all_found]
        rows.append(f"| {kind} | {' | '.join(cells)} |")
    (out / "FOUND.md").write_text("\n".join(rows) + "\n")
    pictures = [shown(name, found[kind]) for kind in VOLUMES for name, found in known.items()]
    write_pixels(out / "SHEET.png", picture_sheet(pictures, len(known)))


if __name__ == "__main__":
    if not SHARED_DATA.is_dir():
        raise SystemExit(f"{SHARED_DATA}: the real volumes are not here")
    places, out = Path(sys.argv[1]), Path(sys.argv[2])
    out.mkdir(parents=True, exist_ok=True)
    for name in sys.argv[3:] or TOOLS:
        measure(places, out, name)
    report(out)
