"""VTK's fixed-point ray caster on the CPU. Its stages run one by one, so that no window, and no OpenGL, is needed."""

import ctypes
from collections.abc import Callable, Sequence

import torch
import vtkmodules.vtkRenderingVolumeOpenGL2  # noqa: F401  what the mapper is made of
from torch import Tensor
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkRenderingCore import vtkCamera, vtkLight, vtkRenderer, vtkVolume, vtkVolumeProperty
from vtkmodules.vtkRenderingOpenGL2 import vtkGenericOpenGLRenderWindow
from vtkmodules.vtkRenderingVolume import vtkFixedPointVolumeRayCastMapper

from volsplat.protocol.geometry.matrices import Vector

FIXED_POINT_ONE = 32767  # of the mapper's pixels

PlacesCamera = Callable[[vtkCamera], None]


class RayCaster:
    """A volume that VTK casts rays through, a sample every `sample_distance` physical units of each ray."""

    def __init__(self, image: vtkImageData, looks: vtkVolumeProperty, sample_distance: float, threads: int = 1) -> None:
        self._mapper = vtkFixedPointVolumeRayCastMapper()
        self._mapper.SetInputData(image)
        self._mapper.AutoAdjustSampleDistancesOff()
        self._mapper.SetImageSampleDistance(1.0)
        self._mapper.SetSampleDistance(sample_distance)
        self._mapper.SetNumberOfThreads(threads)
        self._mapper.IntermixIntersectingGeometryOff()
        self._volume = vtkVolume()
        self._volume.SetMapper(self._mapper)
        self._volume.SetProperty(looks)
        self._window = vtkGenericOpenGLRenderWindow()
        self._renderer = vtkRenderer()
        self._renderer.AutomaticLightCreationOff()
        self._window.AddRenderer(self._renderer)
        self._renderer.AddVolume(self._volume)
        self._size = (0, 0)

    def light(self, toward: Vector, two_sided: bool) -> None:
        """One white light, very far away in the direction `toward` of the volume's physical axes."""
        light = vtkLight()
        light.SetPosition(*toward)
        light.SetFocalPoint(0.0, 0.0, 0.0)
        light.PositionalOff()
        light.SetAmbientColor(1.0, 1.0, 1.0)
        self._renderer.RemoveAllLights()
        self._renderer.AddLight(light)
        self._renderer.SetTwoSidedLighting(two_sided)

    def cast(self, place: PlacesCamera, size: tuple[int, int]) -> None:
        """Draw a frame of (width, height) pixels into the mapper's memory; `place` sets a parallel camera."""
        self._size = size
        self._window.SetSize(*size)
        camera = self._renderer.GetActiveCamera()
        camera.ParallelProjectionOn()
        place(camera)
        self._mapper.PerImageInitialization(self._renderer, self._volume, 0, [0.0, 0.0], [0.0, 0.0, 0.0], [0, 0, 0])
        self._mapper.PerVolumeInitialization(self._renderer, self._volume)
        self._mapper.PerSubVolumeInitialization(self._renderer, self._volume, 0)
        self._mapper.RenderSubVolume()

    def picture(self) -> Tensor:
        """The frame drawn last: (H, W, 4) float32, associated alpha."""
        image = self._mapper.GetRayCastImage()
        columns, rows = image.GetImageMemorySize()
        # VTK hands pointers to Python as text: _0000559bdd99cc40_p_void
        address = int(image.GetImage().split("_")[1], 16)
        memory = (ctypes.c_uint16 * (columns * rows * 4)).from_address(address)
        pixels = torch.frombuffer(bytearray(memory), dtype=torch.uint16).reshape(rows, columns, 4)
        used_columns, used_rows = image.GetImageInUseSize()
        left, bottom = image.GetImageOrigin()
        width, height = self._size
        picture = torch.zeros((height, width, 4))
        # The mapper's own pixels cover the volume's part of the viewport, from the bottom up.
        part = pixels[:used_rows, :used_columns].float() / FIXED_POINT_ONE
        picture[bottom : bottom + used_rows, left : left + used_columns] = part
        return picture.flip(0)


def image_data(values: Tensor, spacing: Sequence[float]) -> vtkImageData:
    """Voxels (k, j, i) as VTK's, copied."""
    from vtkmodules.util.numpy_support import numpy_to_vtk

    image = vtkImageData()
    nk, nj, ni = values.shape
    image.SetDimensions(ni, nj, nk)
    image.SetSpacing(*spacing)
    image.GetPointData().SetScalars(numpy_to_vtk(values.contiguous().numpy().ravel(), deep=True))
    return image
