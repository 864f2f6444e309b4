"""Whether a map of density shows what is there or a difference, as its names or its header's statistics state it."""

import re
from collections.abc import Sequence

from volsplat.protocol.description.kind import Kind

# "2Fo-Fc", "mFo-DFc", "1FO-1FC", "fofc": how many times the observed amplitudes are taken decides.
_COEFFICIENTS = re.compile(r"(\d*)m?fo(?:bs)?[-_ ]*\d*d?fc")
_DIFFERENCES = re.compile(r"del_?ph|delfwt|fofcwt|diff(?!ra)")
_DENSITIES = re.compile(r"2fofcwt|2fofc")

# A density's peaks stand out of its noise, a difference's are as deep as they are high. Of 3EK3, EMD-3001 and 5WKD the
# densities have depths of 0.1 to 0.5 of their heights, 5WKD's difference map has 0.9.
LEAST_DEPTH = 0.7
MOST_MEAN = 0.1  # of the deviation: a difference has the mean 0


def kind_of_names(names: Sequence[str]) -> tuple[Kind, str]:
    """The kind that the first of these texts that states one has, and that text; UNKNOWN and "" for none."""
    for name in names:
        text = name.lower()
        counts = {match[1] for match in _COEFFICIENTS.finditer(text)}
        if counts - {"", "1"} or _DENSITIES.search(text):
            return Kind.CRYSTAL_MAP, name
        if counts or _DIFFERENCES.search(text):
            return Kind.DIFFERENCE_MAP, name
    return Kind.UNKNOWN, ""


def is_difference(least: float, greatest: float, mean: float, deviation: float) -> bool:
    """Whether a crystal's map with these statistics is as deep as it is high. Impossible ones state nothing."""
    if not (least < 0 < greatest and deviation > 0):
        return False
    return abs(mean) <= MOST_MEAN * deviation and LEAST_DEPTH <= -least / greatest <= 1 / LEAST_DEPTH
