"""Frames that are ours and those that are a caller's own, and an error as notebooks show it: under the latter alone."""

from types import FrameType

_PACKAGE = __name__.partition(".")[0]


def is_ours(frame: FrameType) -> bool:
    return str(frame.f_globals.get("__name__")).partition(".")[0] == _PACKAGE


def under_callers_lines(error: BaseException) -> list[str]:
    """For a class's `_render_traceback_`, which is IPython's name for what is shown instead of a whole traceback."""
    import sysconfig  # each program imports this module as it starts, and few show an error so
    import traceback

    libraries = ("<frozen", *map(sysconfig.get_path, ("stdlib", "purelib", "platlib")))
    own = [
        (frame, line)
        for frame, line in traceback.walk_tb(error.__traceback__)
        if not (is_ours(frame) or frame.f_code.co_filename.startswith(libraries))
    ]
    lines = traceback.StackSummary.extract(iter(own)).format()
    return ["".join(lines) + "\n".join([f"{type(error).__name__}: {error}", *getattr(error, "__notes__", ())])]
