"""Which way images come to the client sooner: as they are, or coded. Judged by how those before have come."""

from dataclasses import dataclass

from volsplat.protocol.messages.image_messages import CodedPixels, ImagesTaken

KEPT = 0.7  # of what is known, whenever an image adds to it
LEAST_BYTES = 1 << 16  # of an image that tells the link's rate: smaller ones arrive at once


@dataclass
class _Coding:
    """Of images that are exact, or are not: what each byte of theirs becomes."""

    share: float  # bytes
    coding: float  # seconds
    decoding: float  # seconds


class ImagePace:
    """One connection's. One thread calls it at a time."""

    def __init__(self) -> None:
        self._bytes = self._seconds = 0.0  # of images that have come lately
        self._codings = {False: _Coding(0.04, 1e-9, 1e-9), True: _Coding(0.4, 3e-9, 3e-9)}  # until it is measured
        self._last: tuple[bool, int] = True, 0  # of the one that was coded last: whether exact, and its bytes uncoded

    def coding_pays(self, exact: bool) -> bool:
        if not self._seconds:
            return True  # nothing is known of the link
        coding = self._codings[exact]
        return coding.coding + coding.decoding < (1 - coding.share) * self._seconds / self._bytes

    def coded(self, pixels: CodedPixels, raw_bytes: int) -> None:
        """An image of so many bytes has been coded."""
        coding = self._codings[pixels.exact]
        coding.share = _towards(coding.share, pixels.bytes / raw_bytes)
        coding.coding = _towards(coding.coding, pixels.coding_seconds / raw_bytes)
        self._last = pixels.exact, raw_bytes

    def taken(self, image: ImagesTaken) -> None:
        if image.bytes >= LEAST_BYTES:
            self._bytes = KEPT * self._bytes + image.bytes
            self._seconds = KEPT * self._seconds + image.seconds
        exact, raw_bytes = self._last
        if image.decoding_seconds and raw_bytes:
            coding = self._codings[exact]
            coding.decoding = _towards(coding.decoding, image.decoding_seconds / raw_bytes)


def _towards(known: float, measured: float) -> float:
    return KEPT * known + (1 - KEPT) * measured
