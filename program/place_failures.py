"""Files and folders that the system refuses, wherever that shows: what it says, in one line."""

import errno
import os

from volsplat.protocol.text.errors import BadInput, VolsplatError

_NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # as for what is printed into a file
_NO_WAY_IN = (errno.EACCES, errno.EPERM, errno.ELOOP, errno.ENAMETOOLONG, errno.ENOTDIR, errno.EROFS)


def place_failure(error: BaseException) -> VolsplatError | None:
    """The cause and the cure if a place is full, closed to this user or gone, else None."""
    if not isinstance(error, OSError):
        return None
    reason = os.strerror(error.errno or 0)
    if error.errno in _NO_SPACE:
        return VolsplatError(f"{error.filename or 'the output'} cannot be written: {reason}; write it elsewhere")
    if error.errno in _NO_WAY_IN and error.filename is not None:
        return BadInput(f"{error.filename}: cannot be reached ({reason}); check its name and its folder's permissions")
    if isinstance(error, FileNotFoundError) and error.filename is None and not _is_somewhere():
        return BadInput("the current folder is there no more; change to another one, as by cd ~")
    return None


def _is_somewhere() -> bool:
    """Whether the current folder is there."""
    try:
        os.getcwd()
    except FileNotFoundError:
        return False
    return True
