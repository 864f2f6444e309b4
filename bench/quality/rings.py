"""Rings: how much of the slice spacing can be seen in the lit forehead of the head phantom."""

import torch
from torch import Tensor

from volsplat.bench.quality.findings import Findings, Goal, Row, findings
from volsplat.bench.quality.side_by_side import STEP_G, SideBySide, opened_phantom
from volsplat.bench.ssim import luminance
from volsplat.bench.tables.plot import Panel, Points
from volsplat.client.scene.presets import preset_scene
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.view_rotation import rotation_from_angles
from volsplat.protocol.geometry import matrices
from volsplat.protocol.rules.resolved_view import screen_rotation

FOREHEAD = (0.5, 0.06, 0.75)  # of the grid's sides
ANGLES = (0.0, 0.0)
ZOOM = 6.0  # pixels a voxel
VOXELS = 20  # across the image, all of it forehead
NEAR, AROUND = 0.12, 0.45  # of the frequency: the peak is sought within the first, its neighbours end with the second
GRAIN = (1.5, 4.0)  # slices from ring to ring, where the surface leaves one layer of voxels for the next
SEEN = 0.5  # 255ths: half a step of a screen


def ring_findings() -> Findings:
    """Amplitudes at the slice spacing, in 255ths of luminance, and how far they stand out of their neighbours."""
    with opened_phantom("head", None) as opened:
        scene = forehead(opened)
        period = slice_spacing(opened, scene)
        spectra = {name: spectrum(luminance(picture)) for name, picture in opened.pictures(scene, ()).items()}
    peaks = {name: peak(found, period) for name, found in spectra.items()}
    heights = {name: 255 * height for name, (height, _) in peaks.items()}
    grain = {name: 255 * strongest(found, period) for name, found in spectra.items()}
    rows = [
        Row("a slice long, 255ths", heights, Goal(f"G below {SEEN:g}", heights[STEP_G] < SEEN)),
        Row("strongest of 1.5 to 4 slices", grain, Goal(f"G below {SEEN:g}", grain[STEP_G] < SEEN)),
        Row("a slice long, by its neighbours", {name: height / beside for name, (height, beside) in peaks.items()}),
    ]
    lines = {name: _points(found, period) for name, found in spectra.items()}
    panel = Panel("the lit forehead along the slices' normal", "frequency, per slice", "amplitude, 255ths", lines)
    caption = f"ct-skin at zoom {ZOOM:g}: waves of luminance in the lit forehead; a slice is {period:.2f} pixels."
    return findings("Rings", "waves along the slices' normal", "", rows, caption, [panel])


def forehead(opened: SideBySide) -> Scene:
    center = tuple(share * (count - 1) for share, count in zip(FOREHEAD, opened.geometry.dims, strict=True))
    scene = preset_scene("ct-skin", opened.renderer.volume.subject())
    return opened.settled(
        scene.with_(rotation=rotation_from_angles(*ANGLES), zoom=ZOOM, center=center, size=round(VOXELS * ZOOM))
    )


def slice_spacing(opened: SideBySide, scene: Scene) -> float:
    """Pixels down the image from a slice to the next."""
    normal = matrices.column(opened.geometry.index_to_physical, 2)
    up = matrices.applied(screen_rotation(scene.view), normal)[1]
    return abs(up) / opened.geometry.reference_spacing * ZOOM


def spectrum(picture: Tensor) -> Tensor:
    """Root mean square over columns of the amplitudes (n,) of waves down a picture (H, W), n a picture's height.

    Of what a parabola through each column leaves, fading to both ends.
    """
    height = len(picture)
    place = torch.linspace(-1, 1, height, dtype=torch.float64)
    parabolas = torch.stack((torch.ones_like(place), place, place**2), dim=-1)
    left = picture.double() - parabolas @ torch.linalg.lstsq(parabolas, picture.double()).solution
    window = torch.hann_window(height, periodic=False, dtype=torch.float64)
    waves = torch.fft.rfft(left * window[:, None], dim=0).abs() * 2 / window.sum()
    root: Tensor = waves.square().mean(dim=1).sqrt()
    return root


def peak(spectrum: Tensor, period: float) -> tuple[float, float]:
    """The greatest amplitude of waves about as long as `period` pixels, and the median of those beside them."""
    pixels = 2 * (len(spectrum) - 1)
    share = torch.arange(len(spectrum)) * period / pixels - 1
    near = share.abs() <= max(NEAR, period / pixels)
    beside = ~near & (share.abs() <= AROUND)
    return float(spectrum[near].max()), float(spectrum[beside].median())


def strongest(spectrum: Tensor, period: float) -> float:
    """The greatest amplitude of the waves that the grain of wood has."""
    slices = 2 * (len(spectrum) - 1) / period / torch.arange(len(spectrum)).clamp(min=1)
    return float(spectrum[(slices >= GRAIN[0]) & (slices <= GRAIN[1])].max())


def _points(spectrum: Tensor, period: float) -> Points:
    pixels = 2 * (len(spectrum) - 1)
    return [(n * period / pixels, 255 * float(height)) for n, height in enumerate(spectrum) if n > 2][:80]
