"""What a user of each tool writes for a first picture of a volume: FILE is read, PICTURE is written.

No line more than is needed, no colours, no window: what is asked is what comes without knowing the data. The array is
in a NumPy file, [z, y, x]; its slices are twice as far apart as its pixels.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Tool:
    packages: tuple[str, ...]  # from PyPI, into an environment of its own; none for what a system's packages bring
    program: str  # that runs the scripts
    scripts: dict[str, str]  # by kind of volume, as far as it has a reader
    in_notebook: bool = False  # it draws in a notebook's browser alone: the script is a cell, which shows the picture


OPENED_MRC = "import mrcfile\nmap = mrcfile.open('FILE')\nspacing = map.voxel_size.tolist()\n"
OPENED_FITS = "from astropy.io import fits\ncube = fits.getdata('FILE').squeeze().astype('f4')\n"
DICOM_STACK = (
    "import glob\nimport numpy as np\nimport pydicom\n"
    "slices = [pydicom.dcmread(name) for name in glob.glob('FILE/*')]\n"
    "slices.sort(key=lambda one: one.ImagePositionPatient[2])\n"
    "values = np.stack([one.pixel_array for one in slices])\n"
    "step = slices[1].ImagePositionPatient[2] - slices[0].ImagePositionPatient[2]\n"
    "spacing = (step, *map(float, slices[0].PixelSpacing))\n"
)

VOLSPLAT = Tool(
    (),
    "python",
    {
        **dict.fromkeys(
            ("CT, NIfTI", "CT, DICOM", "map, MRC", "cube, FITS"),
            "import volsplat as vs\nvs.render('FILE').save('PICTURE')\n",
        ),
        "array, NumPy": (
            "import numpy as np\nimport volsplat as vs\n"
            "vs.render(vs.Volume(np.load('FILE'), spacing=(1, 1, 2))).save('PICTURE')\n"
        ),
    },
)

_PV = "volume.plot(volume=True, off_screen=True, screenshot='PICTURE')\n"
PYVISTA = Tool(
    ("pyvista", "pydicom", "mrcfile", "astropy", "nibabel"),
    "python",
    {
        "CT, NIfTI": "import pyvista as pv\nvolume = pv.read('FILE')\n" + _PV,
        "CT, DICOM": "import pyvista as pv\nvolume = pv.DICOMReader('FILE').read()\n" + _PV,
        "array, NumPy": (
            "import numpy as np\nimport pyvista as pv\n"
            "volume = pv.wrap(np.load('FILE').T)\nvolume.spacing = (1, 1, 2)\n" + _PV
        ),
        "map, MRC": OPENED_MRC
        + "import pyvista as pv\nvolume = pv.wrap(map.data.T.copy())\nvolume.spacing = spacing\n"
        + _PV,
        "cube, FITS": OPENED_FITS + "import pyvista as pv\nvolume = pv.wrap(cube.T)\n" + _PV,
    },
)

_VEDO = "show(volume, offscreen=True).screenshot('PICTURE')\n"
VEDO = Tool(
    ("vedo", "mrcfile", "astropy"),
    "python",
    {
        "CT, NIfTI": "from vedo import Volume, show\nvolume = Volume('FILE')\n" + _VEDO,
        "CT, DICOM": "from vedo import Volume, show\nvolume = Volume('FILE')\n" + _VEDO,
        "array, NumPy": (
            "import numpy as np\nfrom vedo import Volume, show\n"
            "volume = Volume(np.load('FILE').T, spacing=(1, 1, 2))\n" + _VEDO
        ),
        "map, MRC": OPENED_MRC
        + "from vedo import Volume, show\nvolume = Volume(map.data.T, spacing=spacing)\n"
        + _VEDO,
        "cube, FITS": OPENED_FITS + "from vedo import Volume, show\nvolume = Volume(cube.T)\n" + _VEDO,
    },
)

_VIEWER = "import napari\nviewer = napari.Viewer(ndisplay=3)\n"
_SHOT = "viewer.screenshot('PICTURE')\n"
NAPARI = Tool(
    ("napari[pyqt6]", "nibabel", "pydicom", "mrcfile", "astropy"),
    "python",
    {
        "CT, NIfTI": (
            "import nibabel\nimage = nibabel.load('FILE')\n"
            + _VIEWER
            + "viewer.add_image(image.get_fdata().T, scale=image.header.get_zooms()[::-1])\n"
            + _SHOT
        ),
        "CT, DICOM": DICOM_STACK + _VIEWER + "viewer.add_image(values, scale=spacing)\n" + _SHOT,
        "array, NumPy": (
            "import numpy as np\n" + _VIEWER + "viewer.add_image(np.load('FILE'), scale=(2, 1, 1))\n" + _SHOT
        ),
        "map, MRC": OPENED_MRC + _VIEWER + "viewer.add_image(map.data, scale=spacing)\n" + _SHOT,
        "cube, FITS": OPENED_FITS + _VIEWER + "viewer.add_image(cube)\n" + _SHOT,
    },
)

_YT = (
    "import yt\nbox = np.array([[0, n * step] for n, step in zip(values.shape, steps)])\n"
    "data = yt.load_uniform_grid({'density': values}, values.shape, bbox=box)\n"
    "yt.volume_render(data, 'density', fname='PICTURE')\n"
)
YT = Tool(
    ("yt", "nibabel", "pydicom", "mrcfile", "astropy"),
    "python",
    {
        "CT, NIfTI": (
            "import nibabel\nimport numpy as np\nimage = nibabel.load('FILE')\nvalues = image.get_fdata()\n"
            "steps = image.header.get_zooms()\n" + _YT
        ),
        "CT, DICOM": DICOM_STACK + "values = values.astype('f8')\nsteps = spacing\n" + _YT,
        "array, NumPy": "import numpy as np\nvalues = np.load('FILE').T.astype('f8')\nsteps = (1, 1, 2)\n" + _YT,
        "map, MRC": OPENED_MRC + "import numpy as np\nvalues = map.data.T.astype('f8')\nsteps = spacing\n" + _YT,
        "cube, FITS": OPENED_FITS + "import numpy as np\nvalues = cube.T.astype('f8')\nsteps = (1, 1, 1)\n" + _YT,
    },
)

_PARAVIEW = "Show(volume).SetRepresentationType('Volume')\nRender()\nSaveScreenshot('PICTURE')\n"
PARAVIEW = Tool(
    (),
    "pvpython",
    {
        "CT, NIfTI": (
            "from paraview.simple import *\n"
            "LoadDistributedPlugin('AnalyzeNIfTIReaderWriter', remote=False, ns=globals())\n"
            "volume = OpenDataFile('FILE')\n" + _PARAVIEW
        ),
        "CT, DICOM": (
            "import glob\nfrom paraview.simple import *\n"
            "volume = DICOMReaderdirectory(FileName=glob.glob('FILE/*')[0])\n" + _PARAVIEW
        ),
        "array, NumPy": (
            "import numpy as np\nvalues = np.load('FILE')\nvalues.tofile('FILE.raw')\n"
            "from paraview.simple import *\nk, j, i = values.shape\n"
            "volume = ImageReader(FileNames=['FILE.raw'], DataScalarType='unsigned short', DataSpacing=[1, 1, 2],\n"
            "    DataByteOrder='LittleEndian', DataExtent=[0, i - 1, 0, j - 1, 0, k - 1])\n" + _PARAVIEW
        ),
        "map, MRC": "from paraview.simple import *\nvolume = OpenDataFile('FILE')\n" + _PARAVIEW,
    },
)

_WIDGET = "import itk\nfrom itkwidgets import view\nview(itk.imread('FILE'))\n"
ITKWIDGETS = Tool(
    # Of later ones the viewer comes from elsewhere than PyPI; with later ipywidgets this one's does not load.
    ("itkwidgets==0.32.6", "itk-io", "notebook==6.4.13", "ipywidgets==7.6.6", "widgetsnbextension==3.5.2", "astropy"),
    "python",
    {
        **dict.fromkeys(("CT, NIfTI", "CT, DICOM", "map, MRC"), _WIDGET),
        "array, NumPy": (
            "import itk\nimport numpy as np\nfrom itkwidgets import view\n"
            "image = itk.image_view_from_array(np.load('FILE'))\nimage.SetSpacing((1, 1, 2))\nview(image)\n"
        ),
        "cube, FITS": OPENED_FITS + "from itkwidgets import view\nview(cube)\n",
    },
    in_notebook=True,
)

TOOLS = {
    "volsplat": VOLSPLAT,
    "pyvista": PYVISTA,
    "vedo": VEDO,
    "napari": NAPARI,
    "yt": YT,
    "itkwidgets": ITKWIDGETS,
    "ParaView": PARAVIEW,
}
