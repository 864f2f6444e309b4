"""Series of volumes in one file: the person chooses one by its number, `series.nii#3`."""

from pathlib import Path

from volsplat.protocol.text.errors import BadInput


def chosen_frame(path: Path, part: str, frames: int) -> int:
    """The frame that `part` names. Raises BadInput where it must be named and is not."""
    if frames == 1 and part not in ("", "0"):
        raise BadInput(f"{path}: holds one volume, it has no part “{part}”; leave out #{part}")
    if frames > 1 and not part:
        raise BadInput(f"{path}: a series of {frames} volumes, numbered from 0; choose one, as in {path}#0")
    number = part or "0"
    if not number.isdecimal() or int(number) >= frames:
        raise BadInput(f"{path}: its volumes are numbered 0 to {frames - 1}; “{part}” is none of them")
    return int(number)
