"""A drawing as SVG: lines and words as such, the picture within as PNG, pixel for pixel."""

from __future__ import annotations

import base64
from xml.etree import ElementTree

from volsplat.client.figure.drawing import Area, Box, Drawing, Line, Ramp, Shape, Words
from volsplat.protocol.description.colours import Colour, nearest_hex

FONTS = "Droid Sans, Helvetica, Arial, sans-serif"
HALO = 0.24  # of the words' size: the stroke behind them

_NAMESPACE = "http://www.w3.org/2000/svg"


def svg_text(drawing: Drawing, png: bytes) -> str:
    """The whole file; `png` is the picture as it is to lie in it."""
    root = svg_element(drawing.width, drawing.height)
    root.set("width", f"{drawing.width / drawing.dpi:.6g}in")
    root.set("height", f"{drawing.height / drawing.dpi:.6g}in")
    if drawing.background is not None:
        _add(root, "rect", width="100%", height="100%", fill=nearest_hex(drawing.background))
    height, width, _ = drawing.picture.shape
    place = {"x": str(drawing.corner[0]), "y": str(drawing.corner[1]), "width": str(width), "height": str(height)}
    data = f"data:image/png;base64,{base64.b64encode(png).decode()}"
    _add(root, "image", **place, href=data)
    add_shapes(root, drawing.shapes)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def svg_of(shapes: list[Shape], width: int, height: int) -> str:
    """Shapes alone, within another document."""
    root = svg_element(width, height)
    add_shapes(root, shapes)
    return ElementTree.tostring(root, encoding="unicode")


def svg_element(width: float, height: float) -> ElementTree.Element:
    """An empty one, whose unit is a pixel."""
    box = f"0 0 {width:g} {height:g}"
    return ElementTree.Element("svg", {"xmlns": _NAMESPACE, "viewBox": box, "font-family": FONTS})


def add_shapes(root: ElementTree.Element, shapes: tuple[Shape, ...] | list[Shape]) -> None:
    for n, shape in enumerate(shapes):
        match shape:
            case Words():
                _add_words(root, shape)
            case Line():
                _add_line(root, shape)
            case Box(x, y, width, height, colour):
                _add(root, "rect", **_box(x, y, width, height), fill=nearest_hex(colour))
            case Ramp(x, y, width, height):
                _add_stops(root, f"ramp-{n}", shape)
                _add(root, "rect", **_box(x, y, width, height), fill=f"url(#ramp-{n})")
            case Area():
                corners = f"M{shape.x:.2f} {shape.y + shape.height:.2f}" + "".join(
                    f"L{x:.2f} {y:.2f}" for x, y in shape.outline()
                )
                path = f"{corners}L{shape.x + shape.width:.2f} {shape.y + shape.height:.2f}Z"
                _add(root, "path", d=path, fill=nearest_hex(shape.colour), fill_opacity=f"{shape.opacity:g}")


def _add(parent: ElementTree.Element, name: str, **attributes: str) -> ElementTree.Element:
    given = {key.replace("_", "-"): value for key, value in attributes.items()}
    return ElementTree.SubElement(parent, name, given)


def _box(x: float, y: float, width: float, height: float) -> dict[str, str]:
    return {"x": f"{x:.2f}", "y": f"{y:.2f}", "width": f"{width:.2f}", "height": f"{height:.2f}"}


def _add_words(root: ElementTree.Element, words: Words) -> None:
    text = _add(root, "text", x=f"{words.x:.2f}", y=f"{words.y:.2f}", fill=nearest_hex(words.colour))
    text.set("font-size", str(words.size))
    text.set("text-anchor", words.anchor.value)
    if words.bold:
        text.set("font-weight", "bold")
    if words.halo is not None:
        _set_halo(text, words.halo, HALO * words.size)
        text.set("stroke-linejoin", "round")
        text.set("paint-order", "stroke")
    text.text = words.text


def _add_line(root: ElementTree.Element, line: Line) -> None:
    ends = {"x1": f"{line.x0:.2f}", "y1": f"{line.y0:.2f}", "x2": f"{line.x1:.2f}", "y2": f"{line.y1:.2f}"}
    if line.halo is not None:
        behind = _add(root, "line", **ends, stroke_linecap="square")
        _set_halo(behind, line.halo, line.thickness * 2)
    _add(root, "line", **ends, stroke=nearest_hex(line.colour), stroke_width=f"{line.thickness:.2f}")


def _set_halo(element: ElementTree.Element, colour: Colour, thickness: float) -> None:
    element.set("stroke", nearest_hex(colour))
    element.set("stroke-width", f"{thickness:.2f}")


def _add_stops(root: ElementTree.Element, name: str, ramp: Ramp) -> None:
    gradient = _add(root, "linearGradient", id=name)
    for position, colour in ramp.stops():
        _add(gradient, "stop", offset=f"{position:.5f}", stop_color=nearest_hex(colour))
