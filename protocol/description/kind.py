"""What kind of data a volume is, and what its values mean where they are classes: as its file states it.

A reader says what it knows, from what the file says of itself and never from the voxels. UNKNOWN is no shame: then
the histogram decides how the volume is first shown.
"""

import math
from enum import StrEnum

import msgspec

from volsplat.protocol.text.printable import printable

# The keys by which an NRRD header that volsplat wrote states both; bands as JSON.
KIND_KEY, BANDS_KEY = "volsplat.kind", "volsplat.bands"


class Kind(StrEnum):
    """The kinds that are shown in ways of their own; the values are the words that people are told."""

    UNKNOWN = "unknown"
    CT = "CT"
    MR = "MR"
    SCAN = "scan"  # of a patient, by another modality
    STATISTIC_MAP = "statistic map"  # of a test, both signs about zero
    LABELS = "labels"  # each whole number is a thing of its own
    CRYSTAL_MAP = "crystallographic map"  # a density by Fourier synthesis, in sigma about its mean
    EM_MAP = "electron microscopy map"
    DIFFERENCE_MAP = "difference map"  # observed less calculated density, both signs about zero
    PATTERSON = "Patterson function"
    STRUCTURE_FACTORS = "structure factors"  # amplitudes; phases as second scalar, or as bands
    ATOM_DENSITY = "atom density"  # electrons, made of the atoms' places
    ELEMENTS = "elements"  # bands of values, each a chemical element
    WAVE_FUNCTION = "wave function"  # both signs about zero
    ELECTRON_DENSITY = "electron density"  # calculated; its square root is a wave function's length
    SPECTRAL_CUBE = "spectral cube"  # two axes on the sky, one of wavelength, frequency or velocity
    SEISMIC = "seismic amplitudes"  # both signs about zero


CLASS_KINDS = (Kind.LABELS, Kind.ELEMENTS)  # whose values are no more or less than others


class Band(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The values from `low` to `high`, both included, are of the class `name`."""

    name: str
    low: float
    high: float
    colour: tuple[float, float, float] | None = None  # 0..1, where the file states one

    def __post_init__(self) -> None:
        msgspec.structs.force_setattr(self, "name", printable(self.name))
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low <= self.high):
            raise ValueError(f"the class {self.name} needs a range of values, not {self.low} to {self.high}")
        if self.colour is not None and not all(0.0 <= channel <= 1.0 for channel in self.colour):
            raise ValueError(f"the class {self.name} needs a colour of three numbers 0 to 1, not {self.colour}")


def stated(kind: Kind, bands: tuple[Band, ...]) -> dict[str, str]:
    """The keys and values of an NRRD header that states these; none where nothing is known."""
    if kind is Kind.UNKNOWN:
        return {}
    return {KIND_KEY: kind.value} | ({BANDS_KEY: msgspec.json.encode(bands).decode()} if bands else {})
