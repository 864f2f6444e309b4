"""What the paper's four colour plates show, and which volume and scene stand for each image here."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from volsplat.client.image.contact_sheet import CAPTIONS
from volsplat.protocol.description.refinement_steps import Step

SCENES = Path(__file__).parent / "scenes"


@dataclass(frozen=True)
class DataSet:
    """One of the paper's volumes: the measured one that stands for it, if any, and the phantom where that is absent.

    Labels say what a volume is; its size is added when it is opened.
    """

    phantom: str
    phantom_label: str
    measured: str = ""  # its path in the folder of data
    part: str = ""  # of that file, after "#"
    measured_label: str = ""
    banded: bool = False  # the phantom: kinds lie in bands of its values, and nothing in between


@dataclass(frozen=True)
class PlateImage:
    """An image of a plate, and the scene that it is drawn with."""

    name: str  # of its file
    caption: str
    data: DataSet
    scene: str
    step: Step = Step.F
    mark: str = ""


@dataclass(frozen=True)
class Plate:
    """Four images: upper left, upper right, lower left, lower right."""

    number: int
    title: str
    images: tuple[PlateImage, PlateImage, PlateImage, PlateImage]


HEAD = DataSet(
    phantom="head",
    phantom_label="head phantom",
    measured="ct_head/ct_head_96x128x113.nrrd",
    measured_label="CT of a head (UNC)",
)
ORBITAL = DataSet(phantom="p-orbital", phantom_label="sigma bond of CuCl, computed")
RNA = DataSet(
    phantom="rna",
    phantom_label="RNA phantom: two stacked arms",
    measured="trna/1ehz.pdb",
    part="density",
    measured_label="tRNA-Phe of yeast (1EHZ), density from its atoms",
)
PROTEIN = DataSet(
    phantom="protein",
    phantom_label="protein phantom: helices of a globin",
    measured="hemoglobin/4HHB.pdb",
    part="elements",
    measured_label="human hemoglobin (4HHB), elements from its atoms",
    banded=True,
)
STRUCTURE_FACTORS = DataSet(
    phantom="structure-factors",
    phantom_label="crystal of the protein phantom",
    measured="sod/1JK9_l_u.pdb",
    part="frequency,3",
    measured_label="yeast superoxide dismutase (1JK9), from its atoms",
    banded=True,
)
GALAXY = DataSet(
    phantom="galaxy",
    phantom_label="galaxy phantom",
    measured="galaxy/ngc6946.fits",
    measured_label="NGC 6946, neutral hydrogen (WSRT)",
)
SEISMIC = DataSet(phantom="seismic", phantom_label="seismic phantom: folds and faults")


def _step(step: Step) -> PlateImage:
    return PlateImage(f"head-step-{step}", CAPTIONS[step], HEAD, "head-skin", step, mark=step.value)


PLATES = (
    Plate(1, "Successive refinement", (_step(Step.A), _step(Step.B), _step(Step.C), _step(Step.D))),
    Plate(
        2,
        "Shading, bone and surfaces",
        (
            _step(Step.E),
            _step(Step.F),
            PlateImage("head-bone", "bone, in green reflected light", HEAD, "head-bone"),
            PlateImage("head-clipped", "surfaces by modulation, clipped", HEAD, "head-clipped"),
        ),
    ),
    Plate(
        3,
        "Electron densities and structure factors",
        (
            PlateImage("p-orbital", "p-orbital and its bond", ORBITAL, "p-orbital"),
            PlateImage("rna", "transfer RNA by gradient strength", RNA, "rna"),
            PlateImage("protein", "protein: green C, blue N, red O, yellow S", PROTEIN, "protein"),
            PlateImage("structure-factors", "structure factors by phase", STRUCTURE_FACTORS, "structure-factors"),
        ),
    ),
    Plate(
        4,
        "A galaxy and a seismic study",
        (
            PlateImage("galaxy-1", "galaxy, colour by velocity", GALAXY, "galaxy-1"),
            PlateImage("galaxy-2", "the same, turned", GALAXY, "galaxy-2"),
            PlateImage("seismic-1", "seismic study, signed", SEISMIC, "seismic-1"),
            PlateImage("seismic-2", "the same, turned", SEISMIC, "seismic-2"),
        ),
    ),
)

IMAGES = tuple(image for plate in PLATES for image in plate.images)


def step_of(image: PlateImage, measured: bool, last: Step, volume_has: Callable[[Step], bool]) -> Step:
    """That an image is drawn in, where `last` stands in the place of F: what has no in-between stays in F."""
    banded = image.data.banded and not measured
    return last if image.step == Step.F and not banded and volume_has(last) else image.step


def scene_path(image: PlateImage, measured: bool) -> Path:
    """The scene file of an image, for the measured volume or for the phantom."""
    return SCENES / ("measured" if measured else "phantom") / f"{image.scene}.toml"
