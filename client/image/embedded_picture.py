"""The picture inside an SVG that volsplat wrote, which holds its scene as any image does."""

import base64
import binascii
import re
from pathlib import Path

from volsplat.protocol.text.errors import BadInput

SVG = ".svg"

_PICTURE = re.compile(rb'<image [^>]*href="data:image/png;base64,([A-Za-z0-9+/=]+)"')


def embedded_png(path: Path) -> bytes:
    """The file that lies in it. Raises BadInput if there is none."""
    try:
        found = _PICTURE.search(path.read_bytes())
    except OSError as error:
        raise BadInput(f"{path}: cannot read the image: {error.strerror}") from error
    if found is None:
        raise BadInput(f"{path}: holds no picture; only images that volsplat wrote do")
    try:
        return base64.b64decode(found[1], validate=True)
    except binascii.Error as error:
        raise BadInput(f"{path}: the picture in it is damaged; write it again") from error
