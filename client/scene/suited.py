"""Whether a preset suits a volume, as far as the file says or its values show, and a line for a person if not."""

from volsplat.client.histogram.subject import Subject
from volsplat.client.scene.presets import PRESETS
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES

LEAST_HOUNSFIELD = 100.0  # from the least to the greatest value: air and tissue are 1000 apart, or a tenth if coarse
BOTH_SIGNS = (Kind.DIFFERENCE_MAP, Kind.SEISMIC)


def why_unsuited(name: str, subject: Subject) -> str | None:
    """One line where the file's word, or else its values, speak against a preset; None where nothing is known."""
    kinds = PRESETS[name].kinds
    if not kinds:
        return None
    if subject.kind is not Kind.UNKNOWN:
        if subject.kind in kinds:
            return None
        wanted = " or ".join(kind.value for kind in kinds)
        return f"the preset {name} is made for {wanted}, and the volume says it is: {subject.kind.value}"
    low, high = subject.values.low, subject.values.high
    if Kind.CT in kinds and subject.ct is None and high - low < LEAST_HOUNSFIELD:
        return f"the preset {name} is made for CT, and values of {low:g} to {high:g} cannot be Hounsfield units"
    if any(kind in BOTH_SIGNS for kind in kinds) and low >= 0:
        return f"the preset {name} is made for values on both sides of 0, and the least here is {low:g}"
    if kinds == (Kind.LABELS,) and high >= TABLE_ENTRIES:
        most = TABLE_ENTRIES - 1
        return f"the preset {name} tells labels up to {most} apart, and the values here reach {high:g}"
    return None
