"""A drawing as PDF, by reportlab: lines and words as such, the picture within without loss. Needs the extra [pdf]."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from volsplat.client.figure.drawing import Anchor, Area, Box, Drawing, Line, Ramp, Shape, Words
from volsplat.client.figure.figure import POINTS_PER_INCH
from volsplat.client.figure.type_faces import Run, runs_of
from volsplat.client.image.image_file import SCENE_KEY
from volsplat.client.image.image_formats import need_pdf
from volsplat.client.image.lettering import BOLD_FONT
from volsplat.protocol.description.colours import Colour

HALO = 0.24  # of the words' size: the stroke behind them
STROKE, FILL = 1, 0  # how reportlab renders text


def pdf_bytes(drawing: Drawing, picture: NDArray[np.uint8], title: str, scene: str) -> bytes:
    """The whole file, equal for equal drawings; `picture` is (H, W, 3 or 4) with straight alpha. Raises BadInput."""
    need_pdf()
    import PIL.Image
    from reportlab.lib.utils import ImageReader
    from reportlab.pdfbase.pdfdoc import PDFDictionary, PDFInfo, PDFString
    from reportlab.pdfgen.canvas import Canvas

    per_pixel = POINTS_PER_INCH / drawing.dpi
    file = io.BytesIO()
    size = (drawing.width * per_pixel, drawing.height * per_pixel)
    canvas = Canvas(file, pagesize=size, invariant=1, pageCompression=1)
    told = {"Title": title, "Creator": "volsplat", SCENE_KEY: scene}

    class Info(PDFInfo):  # type: ignore[misc]
        """With keys of our own, which reportlab has no call for."""

        def format(self, document: Any) -> Any:
            return PDFDictionary({key: PDFString(text) for key, text in told.items()}).format(document)

    canvas._doc.info = Info()
    canvas.scale(per_pixel, per_pixel)
    if drawing.background is not None:
        canvas.setFillColorRGB(*drawing.background)
        canvas.rect(0, 0, drawing.width, drawing.height, stroke=0, fill=1)
    height, width, _ = picture.shape
    left, top = drawing.corner
    reader = ImageReader(PIL.Image.fromarray(picture))
    canvas.drawImage(reader, left, drawing.height - top - height, width, height, mask="auto")
    for shape in drawing.shapes:
        _Pen(canvas, drawing.height).draw(shape)
    canvas.showPage()
    canvas.save()
    return file.getvalue()


class _Pen:
    """Draws shapes whose y runs down."""

    def __init__(self, canvas: Any, height: int) -> None:
        self._canvas = canvas
        self._height = height

    def draw(self, shape: Shape) -> None:
        match shape:
            case Words():
                self._words(shape)
            case Line():
                self._line(shape)
            case Box(x, y, width, height, colour):
                self._canvas.setFillColorRGB(*colour)
                self._canvas.rect(x, self._height - y - height, width, height, stroke=0, fill=1)
            case Ramp():
                self._ramp(shape)
            case Area():
                self._area(shape)

    def _words(self, words: Words) -> None:
        from reportlab.pdfbase.pdfmetrics import stringWidth

        canvas = self._canvas
        runs = [Run(run.text, _registered(run.font)) for run in runs_of(words.text, words.bold)]
        wide = sum(stringWidth(run.text, run.font, words.size) for run in runs)
        x = words.x - {Anchor.START: 0.0, Anchor.MIDDLE: wide / 2, Anchor.END: wide}[words.anchor]
        if words.halo is not None:
            canvas.setLineJoin(1)
            canvas.setLineWidth(HALO * words.size)
            canvas.setStrokeColorRGB(*words.halo)
            self._text(words, runs, x, STROKE)
        canvas.setFillColorRGB(*words.colour)
        self._text(words, runs, x, FILL)

    def _text(self, words: Words, runs: Sequence[Run], x: float, mode: int) -> None:
        self._canvas.saveState()  # a mode holds beyond the text
        line = self._canvas.beginText(x, self._height - words.y)
        line.setTextRenderMode(mode)
        for run in runs:
            line.setFont(run.font, words.size)
            line.textOut(run.text)
        self._canvas.drawText(line)
        self._canvas.restoreState()

    def _line(self, line: Line) -> None:
        if line.halo is not None:
            self._stroke(line, line.thickness * 2, line.halo, cap=2)
        self._stroke(line, line.thickness, line.colour, cap=0)

    def _stroke(self, line: Line, thickness: float, colour: Colour, cap: int) -> None:
        self._canvas.setLineCap(cap)
        self._canvas.setLineWidth(thickness)
        self._canvas.setStrokeColorRGB(*colour)
        self._canvas.line(line.x0, self._height - line.y0, line.x1, self._height - line.y1)

    def _ramp(self, ramp: Ramp) -> None:
        from reportlab.lib.colors import Color

        canvas = self._canvas
        y = self._height - ramp.y - ramp.height
        canvas.saveState()
        clip = canvas.beginPath()
        clip.rect(ramp.x, y, ramp.width, ramp.height)
        canvas.clipPath(clip, stroke=0, fill=0)
        stops = ramp.stops()
        positions, colours = [position for position, _ in stops], [Color(*colour) for _, colour in stops]
        canvas.linearGradient(ramp.x, y, ramp.x + ramp.width, y, colours, positions, extend=True)
        canvas.restoreState()

    def _area(self, area: Area) -> None:
        canvas, base = self._canvas, self._height - area.y - area.height
        path = canvas.beginPath()
        path.moveTo(area.x, base)
        for x, y in area.outline():
            path.lineTo(x, self._height - y)
        path.lineTo(area.x + area.width, base)
        path.close()
        canvas.saveState()
        canvas.setFillColorRGB(*area.colour)
        canvas.setFillAlpha(area.opacity)
        canvas.drawPath(path, stroke=0, fill=1)
        canvas.restoreState()


def _registered(face: str) -> str:
    """The font that words on pictures have, known to reportlab; Helvetica if its file is not found."""
    from reportlab.pdfbase import pdfmetrics
    from reportlab.pdfbase.ttfonts import TTFont

    if face in pdfmetrics.getRegisteredFontNames():
        return face
    for place in oiio.get_string_attribute("font_file_list").split(";"):
        if Path(place).stem == face:
            pdfmetrics.registerFont(TTFont(face, place))
            return face
    return "Helvetica-Bold" if face == BOLD_FONT else "Helvetica"
