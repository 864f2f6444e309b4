"""Numbers of bytes as people write them."""

import re

from volsplat.protocol.text.errors import BadInput

ON_DISK = ("B", "kB", "MB", "GB", "TB", "PB")
UNITS = {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30, "T": 1 << 40}


def bytes_from_option(option: str, text: str) -> int:
    """A number of bytes with an optional K, M, G or T. Raises BadInput."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)([KMGT]?)B?", text.strip().upper())
    if match is None:
        raise BadInput(f"{option} {text}: give a size such as 800M or 4G")
    return int(float(match[1]) * UNITS[match[2]])


def bytes_text(count: float) -> str:
    """As a person reads it, in the units of the options: "1.5 GiB", "310.0 MiB"."""
    return f"{count / UNITS['G']:.1f} GiB" if count >= UNITS["G"] else f"{max(count, 0) / UNITS['M']:.1f} MiB"


def size_on_disk(count: int) -> str:
    """As file managers write it, to three digits and by thousands: "117 B", "1.56 MB"."""
    power = 0
    while power < len(ON_DISK) - 1 and float(f"{count / 1000**power:.3g}") >= 1000:  # 999,600 bytes are 1 MB
        power += 1
    return f"{count / 1000**power:.3g} {ON_DISK[power]}"
