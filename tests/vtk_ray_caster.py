"""Another renderer's picture of a NRRD file: VTK's fixed-point ray caster, read, seen and cast by VTK alone.

Its stages run one by one, so that no window, and no OpenGL, is needed.
"""

import ctypes
from collections.abc import Callable
from pathlib import Path

import torch
import vtkmodules.vtkRenderingVolumeOpenGL2  # noqa: F401  what the mapper is made of
from torch import Tensor
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkPiecewiseFunction
from vtkmodules.vtkImagingCore import vtkExtractVOI, vtkImageFlip
from vtkmodules.vtkIOImage import vtkNrrdReader
from vtkmodules.vtkRenderingCore import vtkCamera, vtkRenderer, vtkVolume, vtkVolumeProperty
from vtkmodules.vtkRenderingOpenGL2 import vtkGenericOpenGLRenderWindow
from vtkmodules.vtkRenderingVolume import vtkFixedPointVolumeRayCastMapper

from volsplat.protocol.volume import Index

FIXED_POINT_ONE = 32767  # of the mapper's pixels
FAR = 1e3  # physical units: the camera stays outside of the volume
SAMPLE_DISTANCE = 0.2  # voxels

PlacesCamera = Callable[[vtkCamera], None]  # turns a camera that looks at the origin from (0, -FAR, 0), +z up


class RayCaster:
    """A volume whose values above `threshold` are opaque and all others clear, in trilinear interpolation."""

    def __init__(self, path: Path, threshold: float, dims: Index, flipped: int | None = None) -> None:
        """Hold the first `dims` voxels of each axis, in reverse along the axis `flipped`."""
        reader = vtkNrrdReader()
        reader.SetFileName(str(path))
        reader.Update()  # the whole: it cannot read parts
        part = vtkExtractVOI()
        part.SetInputData(reader.GetOutput())
        part.SetVOI(0, dims[0] - 1, 0, dims[1] - 1, 0, dims[2] - 1)
        part.Update()
        image: vtkImageData = part.GetOutput()
        if flipped is not None:
            flip = vtkImageFlip()
            flip.SetInputData(image)
            flip.SetFilteredAxis(flipped)
            flip.Update()
            image = flip.GetOutput()
        self.spacing: tuple[float, float, float] = image.GetSpacing()
        opacity = vtkPiecewiseFunction()
        opacity.AddPoint(threshold, 0.0)
        opacity.AddPoint(threshold + 1e-3, 1.0)
        looks = vtkVolumeProperty()
        looks.SetScalarOpacity(opacity)
        looks.SetInterpolationTypeToLinear()
        self._mapper = vtkFixedPointVolumeRayCastMapper()
        self._mapper.SetInputData(image)
        self._mapper.AutoAdjustSampleDistancesOff()
        self._mapper.SetImageSampleDistance(1.0)
        self._mapper.SetSampleDistance(SAMPLE_DISTANCE * min(self.spacing))
        self._mapper.SetNumberOfThreads(1)
        self._volume = vtkVolume()
        self._volume.SetMapper(self._mapper)
        self._volume.SetProperty(looks)

    def alpha(
        self, place: PlacesCamera, size: tuple[int, int], center: tuple[float, float, float], pixel: float
    ) -> Tensor:
        """The opacity (height, width) 0..1, in parallel projection; a pixel is so many physical units wide."""
        width, height = size
        window = vtkGenericOpenGLRenderWindow()
        window.SetSize(width, height)
        renderer = vtkRenderer()
        window.AddRenderer(renderer)
        renderer.AddVolume(self._volume)
        self._place(renderer.GetActiveCamera(), place, center, height * pixel)
        self._mapper.PerImageInitialization(renderer, self._volume, 0, [0.0, 0.0], [0.0, 0.0, 0.0], [0, 0, 0])
        self._mapper.PerVolumeInitialization(renderer, self._volume)
        self._mapper.PerSubVolumeInitialization(renderer, self._volume, 0)
        self._mapper.RenderSubVolume()
        return self._cast(width, height)

    def _place(
        self, camera: vtkCamera, place: PlacesCamera, center: tuple[float, float, float], picture_height: float
    ) -> None:
        camera.ParallelProjectionOn()
        camera.SetParallelScale(picture_height / 2)
        camera.SetFocalPoint(0.0, 0.0, 0.0)
        camera.SetPosition(0.0, -FAR, 0.0)
        camera.SetViewUp(0.0, 0.0, 1.0)
        place(camera)
        target = [index * spacing for index, spacing in zip(center, self.spacing, strict=True)]
        position = camera.GetPosition()
        camera.SetFocalPoint(*target)
        camera.SetPosition(*(p + t for p, t in zip(position, target, strict=True)))
        camera.SetClippingRange(FAR / 2, FAR * 2)

    def _cast(self, width: int, height: int) -> Tensor:
        """The mapper's own pixels, which cover the volume's part of the viewport, from the bottom up."""
        image = self._mapper.GetRayCastImage()
        columns, rows = image.GetImageMemorySize()
        # VTK hands pointers to Python as text: _0000559bdd99cc40_p_void
        address = int(image.GetImage().split("_")[1], 16)
        memory = (ctypes.c_uint16 * (columns * rows * 4)).from_address(address)
        pixels = torch.frombuffer(bytearray(memory), dtype=torch.uint16).reshape(rows, columns, 4)
        used_columns, used_rows = image.GetImageInUseSize()
        left, bottom = image.GetImageOrigin()
        alpha = torch.zeros((height, width))
        part = pixels[:used_rows, :used_columns, 3].float() / FIXED_POINT_ONE
        alpha[bottom : bottom + used_rows, left : left + used_columns] = part
        return alpha.flip(0)
