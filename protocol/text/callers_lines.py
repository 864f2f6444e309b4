"""An error as notebooks and IPython show it: the caller's own lines, and the message under them."""

import sysconfig
import traceback
from types import FrameType

LIBRARIES = ("<frozen", *(sysconfig.get_path(kind) for kind in ("stdlib", "purelib", "platlib")))


def under_callers_lines(error: BaseException) -> list[str]:
    """For a class's `_render_traceback_`, which is IPython's name for what is shown instead of a whole traceback."""
    own = [place for place in traceback.walk_tb(error.__traceback__) if _is_callers(place[0])]
    lines = traceback.StackSummary.extract(iter(own)).format()
    return ["".join(lines) + "\n".join([f"{type(error).__name__}: {error}", *getattr(error, "__notes__", ())])]


def _is_callers(frame: FrameType) -> bool:
    package = str(frame.f_globals.get("__name__")).partition(".")[0]
    return package != __name__.partition(".")[0] and not frame.f_code.co_filename.startswith(LIBRARIES)
