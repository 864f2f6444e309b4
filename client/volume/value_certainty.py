"""What the 8 bits of a voxel still say of its value in the file: it itself, a value near it, or a bound."""

from __future__ import annotations

import enum

from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.scene import Quantise
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES
from volsplat.protocol.messages.frame_messages import ProbedVoxel

_LAST_BYTE = TABLE_ENTRIES - 1


class Certainty(enum.StrEnum):
    """How a told value stands to the file's; its text is the sign before the told one.

    ABOUT, AT_LEAST and AT_MOST are true within half a step of the 256 that lie between the ends of the range.
    """

    EXACT = ""
    ABOUT = "≈"
    AT_LEAST = "≥"
    AT_MOST = "≤"


def density_certainty(voxel: ProbedVoxel, volume: SurveyedVolume, quantise: Quantise) -> Certainty:
    """Whether the file's value is the voxel's density, near it, or somewhere beyond the density window's end."""
    quantisation = volume.quantisation(quantise)
    low, high = quantisation.window
    byte = round((voxel.density - low) * quantisation.density_scale)
    if byte == _LAST_BYTE and volume.survey.high > high:
        return Certainty.AT_LEAST
    if byte == 0 and volume.survey.low < low:
        return Certainty.AT_MOST
    # Prepared volumes may be shown by coarser levels, whose values are means.
    whole = "int" in volume.description.scalar_type and low == round(low) and volume.prepared is None
    return Certainty.EXACT if whole and quantisation.density_scale == 1.0 else Certainty.ABOUT


def strength_certainty(voxel: ProbedVoxel, volume: SurveyedVolume) -> Certainty:
    """Likewise of its strength, of which the greatest are beyond what steps are made for."""
    least, most = volume.description.second_scalar or (0.0, volume.survey.max_gradient)
    if volume.strength_scale == 0.0:
        return Certainty.EXACT
    byte = round((voxel.strength - least) * volume.strength_scale)
    beyond = byte == _LAST_BYTE and most > least + _LAST_BYTE / volume.strength_scale
    return Certainty.AT_LEAST if beyond else Certainty.ABOUT
