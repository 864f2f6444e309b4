"""Another renderer's picture of a NRRD file: VTK's fixed-point ray caster, read, seen and cast by VTK alone."""

from pathlib import Path

from torch import Tensor
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkPiecewiseFunction
from vtkmodules.vtkImagingCore import vtkExtractVOI, vtkImageFlip
from vtkmodules.vtkIOImage import vtkNrrdReader
from vtkmodules.vtkRenderingCore import vtkCamera, vtkVolumeProperty

from volsplat.bench.peers.vtk_ray_caster import PlacesCamera, RayCaster
from volsplat.protocol.description.volume import Index

FAR = 1e3  # physical units: the camera stays outside of the volume
SAMPLE_DISTANCE = 0.2  # voxels


class OpaqueCast:
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
        self._caster = RayCaster(image, looks, SAMPLE_DISTANCE * min(self.spacing))

    def alpha(
        self, place: PlacesCamera, size: tuple[int, int], center: tuple[float, float, float], pixel: float
    ) -> Tensor:
        """The opacity (height, width) 0..1, in parallel projection; a pixel is so many physical units wide.

        `place` turns a camera that looks at the origin from (0, -FAR, 0), +z up.
        """

        def placed(camera: vtkCamera) -> None:
            camera.SetParallelScale(size[1] * pixel / 2)
            camera.SetFocalPoint(0.0, 0.0, 0.0)
            camera.SetPosition(0.0, -FAR, 0.0)
            camera.SetViewUp(0.0, 0.0, 1.0)
            place(camera)
            target = [index * spacing for index, spacing in zip(center, self.spacing, strict=True)]
            position = camera.GetPosition()
            camera.SetFocalPoint(*target)
            camera.SetPosition(*(p + t for p, t in zip(position, target, strict=True)))
            camera.SetClippingRange(FAR / 2, FAR * 2)

        self._caster.cast(placed, size)
        return self._caster.picture()[..., 3]
