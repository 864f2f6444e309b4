"""The kind of a medical volume by what its file, or the name and the notes that converters give it, say of it."""

import json
import re
from pathlib import Path

from volsplat.protocol.description.kind import Kind

# DICOM's words (PS3.3, C.7.3.1.1.1). Others that are images of a patient are one kind: no tables are made for them.
_BY_MODALITY = {"": Kind.UNKNOWN, "OT": Kind.UNKNOWN, "CT": Kind.CT, "MR": Kind.MR, "SEG": Kind.LABELS}

# The last word of a name by the Brain Imaging Data Structure, as in sub-01_ses-2_T1w.nii.gz.
_BIDS_NAME = re.compile(r"sub-[a-zA-Z0-9]+_(?:.*_)?([a-zA-Z0-9]+)\.nii(?:\.gz)?")
_BY_SUFFIX = {
    **dict.fromkeys(("T1w", "T2w", "T2star", "T2starw", "PDw", "PDT2", "FLAIR", "inplaneT1", "inplaneT2"), Kind.MR),
    **dict.fromkeys(("T1map", "T2map", "PDmap", "R1map", "R2map", "UNIT1", "bold", "cbv", "sbref", "dwi"), Kind.MR),
    **dict.fromkeys(("angio", "asl", "m0scan", "magnitude", "magnitude1", "magnitude2", "epi"), Kind.MR),
    **{"ct": Kind.CT, "pet": Kind.SCAN, "dseg": Kind.LABELS, "mask": Kind.LABELS},
}
_LONGEST_NOTES = 1 << 20


def kind_of_modality(modality: str) -> tuple[Kind, str]:
    """The kind by DICOM's word for the machine, and what states it; UNKNOWN and "" for none."""
    kind = _BY_MODALITY.get(modality, Kind.SCAN)
    return kind, f"modality {modality}" if kind != Kind.UNKNOWN else ""


def kind_beside(path: Path) -> tuple[Kind, str]:
    """The kind by the file's name, if that follows BIDS, or by the .json that dcm2niix writes beside it."""
    if (match := _BIDS_NAME.fullmatch(path.name)) and match[1] in _BY_SUFFIX:
        return _BY_SUFFIX[match[1]], f"its name, which ends in {match[1]}"
    notes = path.with_name(re.sub(r"\.(nii|hdr|img)(\.gz)?$", "", path.name) + ".json")
    kind, kind_from = kind_of_modality(_stated_modality(notes))
    return kind, f"{kind_from} in {notes.name}" if kind_from else ""


def _stated_modality(notes: Path) -> str:
    """What notes in JSON say of the modality; "" for notes that cannot be read."""
    try:
        if not notes.is_file() or notes.stat().st_size > _LONGEST_NOTES:
            return ""
        told = json.loads(notes.read_bytes())
    except (OSError, ValueError, RecursionError):
        return ""
    stated = told.get("Modality", "") if isinstance(told, dict) else ""
    return stated if isinstance(stated, str) else ""
