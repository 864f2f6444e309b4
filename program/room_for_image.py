"""Whether a machine has room for an image: said before it is drawn, or the system might kill whoever draws it."""

from volsplat.program.machine_limits import available_memory
from volsplat.protocol.text.byte_sizes import bytes_text
from volsplat.protocol.text.errors import BadInput

PIXEL_BYTES = 16  # float32 RGBA
TIMES = 2  # it is held by whoever draws it, and by whoever has it: while it is drawn, and as it is shown
SMALL = 64 << 20  # bytes that are not worth a look


def check_room_for_image(width: int, height: int, held: tuple[int, int] = (0, 0)) -> None:
    """Raises BadInput if an image of this size takes more than this machine has left, once the `held` one is let go."""
    needed, let_go = (TIMES * PIXEL_BYTES * pixels for pixels in (width * height, held[0] * held[1]))
    if (width, height) != held:
        _check(f"an image of {width} x {height} pixels", needed, let_go, "ask for a smaller one")


def check_room_for_slabs(width: int, lines: int, pixel_bytes: int) -> None:
    """Raises BadInput if planes of `pixel_bytes` for each of these pixels take more than this machine has left."""
    what = f"step G's planes of {width} x {lines} pixels"
    _check(what, pixel_bytes * width * lines, 0, "ask for a smaller image, or for step F")


def _check(what: str, needed: int, let_go: int, cure: str) -> None:
    if needed > SMALL and needed > (left := available_memory() + let_go):
        raise BadInput(
            f"no memory for {what}: it needs {bytes_text(needed)}, but this machine has {bytes_text(left)} left; {cure}"
        )
