"""Figures in files: the picture's pixels as they are, words as words, the size in print."""

from __future__ import annotations

import base64
import ctypes
from pathlib import Path
from xml.etree import ElementTree

import msgspec
import numpy as np
import PIL.Image
import pypdfium2
import pypdfium2.raw
import pytest
from numpy.typing import NDArray

import volsplat as vs
from support.files.head_volume import SIZE, head
from support.files.images import read_image
from support.programs.programs import Person
from tolerances import ONE_LEVEL
from volsplat.client.figure.characters import LATIN, MORE, SIGNS, check_words, legible
from volsplat.client.figure.drawing import Drawing, Line, Words
from volsplat.client.figure.figure import BARE, POINTS_PER_INCH, Figure, figure_with
from volsplat.client.figure.figure_file import write_picture
from volsplat.client.figure.layout import laid_out, sized
from volsplat.client.figure.painted import painted
from volsplat.client.figure.pdf_file import _registered
from volsplat.client.figure.type_faces import WIDE_FONT, runs_of, width_of
from volsplat.client.image.image_file import read_scene, write_image
from volsplat.client.image.lettering import BOLD_FONT, FONT
from volsplat.client.session.single import SingleProcess
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.colours import colour_from_text
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.text.errors import BadInput

__all__ = ["head"]

FIGURE = Figure(title="a small head", dpi=100, labels=(("middle", (16.0, 20.0, 18.0)), ("nowhere", (999.0, 0.0, 0.0))))
LONG = Figure(title="a title that nobody can read " * 4, width=2.0)
Pixels = NDArray[np.float32]
Drawn = tuple[Pixels, Scene, SurveyedVolume]


@pytest.fixture(scope="module")
def drawn(head: Path) -> Drawn:
    with SingleProcess(head, threads=1) as renderer:
        scene = renderer.volume.default_scene().with_(size=(240, 200), background="navy", rotation="front")
        return renderer.finish(scene).published.pixels.copy(), scene, renderer.volume


def levels(path: Path) -> NDArray[np.uint8]:
    """As they are stored, colours not multiplied by alpha."""
    with PIL.Image.open(path) as opened:
        return np.array(opened)


def test_a_picture_alone_is_the_plain_image_to_the_bit(drawn: Drawn) -> None:
    picture, scene, volume = drawn
    assert np.array_equal(painted(laid_out(picture, BARE, scene, volume)), picture)


def test_pixels_that_nothing_is_drawn_over_are_the_plain_images(drawn: Drawn) -> None:
    picture, scene, volume = drawn
    drawing = laid_out(picture, FIGURE, scene, volume)
    x, y = drawing.corner
    inside = painted(drawing)[y : y + picture.shape[0], x : x + picture.shape[1]]
    over = np.zeros(picture.shape[:2], bool)
    for shape in drawing.shapes:
        if isinstance(shape, Words):
            reach = 2 * shape.size
            wide = width_of(shape.text, shape.size, shape.bold) + reach
            ends = (shape.x - wide, shape.y - reach, shape.x + wide, shape.y + reach)
        elif isinstance(shape, Line):
            ends = (min(shape.x0, shape.x1) - 8, min(shape.y0, shape.y1) - 8, max(shape.x0, shape.x1) + 8, 0)
            ends = (*ends[:3], max(shape.y0, shape.y1) + 8)
        else:
            continue
        left, top, right, bottom = (max(int(end), 0) for end in ends)
        over[max(top - y, 0) : max(bottom - y, 0), max(left - x, 0) : max(right - x, 0)] = True
    changed = (inside != picture).any(axis=2)
    assert changed.any() and not (changed & ~over).any() and not over.all()


@pytest.mark.parametrize("transparent", [False, True])
def test_svg_and_pdf_hold_the_plain_images_pixels_and_words_as_words(
    drawn: Drawn, tmp_path: Path, transparent: bool
) -> None:
    picture, scene, volume = drawn
    figure = figure_with(FIGURE, {"transparent": transparent})
    plain, svg, pdf, inside = (tmp_path / name for name in ("plain.png", "a.svg", "a.pdf", "inside.png"))
    write_image(plain, picture, scene, transparent=transparent)
    for path in (svg, pdf):
        write_picture(path, picture, scene, volume, figure)
        written = path.read_bytes()
        write_picture(path, picture, scene, volume, figure)
        assert path.read_bytes() == written

    assert read_scene(svg) == scene
    root = ElementTree.parse(svg).getroot()
    namespace = {"svg": "http://www.w3.org/2000/svg"}
    (image,) = root.findall("svg:image", namespace)
    inside.write_bytes(base64.b64decode(image.attrib["href"].partition(",")[2]))
    with PIL.Image.open(inside) as stored:
        assert stored.info["dpi"] == pytest.approx((100, 100), abs=0.1)
    assert np.array_equal(levels(inside), levels(plain)) and read_scene(inside) == scene
    height = laid_out(picture, figure, scene, volume).height
    assert root.attrib["width"] == "2.4in" and root.attrib["height"] == f"{height / 100:g}in"
    texts = {element.text for element in root.findall("svg:text", namespace)}
    assert {"a small head", "middle"} <= texts and "nowhere" not in texts

    with pypdfium2.PdfDocument(pdf) as opened:
        page = opened[0]
        assert page.get_size() == pytest.approx((240 / 100 * POINTS_PER_INCH, height / 100 * POINTS_PER_INCH), abs=1e-2)
        (stored,) = (one for one in page.get_objects() if one.type == pypdfium2.raw.FPDF_PAGEOBJ_IMAGE)
        colours = stored.get_bitmap(render=False).to_pil().convert("RGB")
        assert np.array_equal(np.asarray(colours), levels(plain)[..., :3])
        said = page.get_textpage().get_text_range()
        told = {key: meta_text(opened, key) for key in ("Title", "Creator", "Subject", "Author")}
        assert msgspec.json.decode(meta_text(opened, "volsplat:scene"), type=Scene) == scene
    assert told == {"Title": "a small head", "Creator": "volsplat", "Subject": "", "Author": ""}
    assert all(text in said for text in ("a small head", "middle", "opacity"))


def meta_text(document: pypdfium2.PdfDocument, key: str) -> str:
    """What a PDF file says of itself under a name, perhaps of nobody else's."""
    bytes_ = pypdfium2.raw.FPDF_GetMetaText(document, key.encode(), None, 0)
    buffer = ctypes.create_string_buffer(bytes_)
    pypdfium2.raw.FPDF_GetMetaText(document, key.encode(), buffer, bytes_)
    return buffer.raw.decode("utf-16-le").rstrip("\0")


def test_a_transparent_picture_has_its_colours_whatever_their_alpha(drawn: Drawn, tmp_path: Path) -> None:
    picture, scene, _ = drawn
    write_image(tmp_path / "clear.png", picture, scene, transparent=True)
    stored = levels(tmp_path / "clear.png") / 255.0
    alpha = picture[..., 3:]
    assert stored.shape[2] == 4 and 0 < (alpha > 0).mean() < 1
    assert np.abs(stored[..., 3:] - alpha).max() <= ONE_LEVEL / 2 + 1e-6
    seen = alpha[..., 0] > 0
    assert np.abs(stored[..., :3] - np.clip(picture[..., :3] / np.maximum(alpha, 1e-9), 0, 1))[seen].max() <= ONE_LEVEL


def test_the_fonts_have_what_is_said_of_them() -> None:
    from reportlab.pdfbase.pdfmetrics import getFont

    for face, characters in ((FONT, LATIN), (BOLD_FONT, LATIN), (WIDE_FONT, LATIN | MORE | SIGNS)):
        glyphs = getFont(_registered(face)).face.charToGlyph
        assert not [character for character in characters if ord(character) not in glyphs], face


@pytest.mark.parametrize("bold", [False, True])
def test_a_line_keeps_its_font_but_for_characters_that_this_lacks(bold: bool) -> None:
    face = BOLD_FONT if bold else FONT
    runs = runs_of("NGC 6946 αβγ 21 cm", bold)
    assert runs == [("NGC 6946 ", face), ("αβγ", WIDE_FONT), (" 21 cm", face)]
    before = width_of("a |", 20, bold)
    whole = _drawn_words("a |αβ| b", 10.0, bold)
    assert np.array_equal(whole[:, : 10 + before], _drawn_words("a |", 10.0, bold)[:, : 10 + before])
    inked, alone = (_columns(pixels) for pixels in (whole, _drawn_words("| b", 10.0, bold)))
    assert np.array_equal(inked[:, -alone.shape[1] :], alone)
    assert not runs_of("") and width_of("", 20) == 0


def _columns(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """From the first that has ink to the last."""
    inked = np.flatnonzero(pixels[..., 3].max(axis=0))
    return pixels[:, inked[0] : inked[-1] + 1]


def _drawn_words(text: str, x: float, bold: bool) -> NDArray[np.float32]:
    words = Words(x, 40.0, text, 20, (1.0, 1.0, 1.0), bold=bold)
    return painted(Drawing(400, 60, 72.0, np.zeros((1, 1, 4), np.float32), (0, 0), None, (words,)))


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"dpi": 3}, 'figure: dpi must be 20 to 2400 pixels per inch or "auto", not 3.0'),
        ({"ink": "inkish"}, "inkish"),
        ({"labels": [("nose", (1, 2))]}, "labels"),
        ({"size": 4}, "a figure has no size; it has scale_bar, colour_bar"),
    ],
)
def test_options_that_no_figure_has_are_refused_in_one_line(options: dict[str, object], line: str) -> None:
    with pytest.raises(BadInput) as refused:
        figure_with(Figure(), options)
    assert line in str(refused.value) and "\n" not in str(refused.value)


def test_words_of_a_file_are_told_in_characters_that_there_are() -> None:
    assert legible("km s⁻¹ − µm Å") == "km s–¹ – µm Å"
    assert legible("λ [頭]") == "λ [?]"
    assert Figure(title="a\x00b\n").title.isprintable()


def test_a_title_is_smaller_where_it_is_long_and_refused_where_it_would_not_be_read(drawn: Drawn) -> None:
    picture, scene, volume = drawn
    sizes = [
        next(
            shape.size for shape in laid_out(picture, Figure(title=text), scene, volume).shapes if type(shape) is Words
        )
        for text in ("short", "rather longer than short, so long that there is no room")
    ]
    assert sizes[0] > sizes[1]
    for refused in (lambda: laid_out(picture, LONG, scene, volume), lambda: sized(LONG, scene, volume)):
        with pytest.raises(BadInput, match="the figure's title has no room"):
            refused()


def test_a_picture_too_narrow_for_colour_bars_is_refused_for_that(drawn: Drawn) -> None:
    """And not for a title that it does not have."""
    _, scene, volume = drawn
    for width in (1, 3, 40, 64):
        with pytest.raises(BadInput, match=f"a picture of {width} pixels is too narrow for colour bars"):
            sized(Figure(dpi=300), scene.with_(size=(width, 300)), volume)
        assert sized(Figure(colour_bar=False), scene.with_(size=(width, 300)), volume).image.width == width


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_classes_are_told_in_few_pixels(suffix: str, tmp_path: Path) -> None:
    labels = np.zeros((8, 8, 8), np.uint8)
    labels[2:6, 2:6, 2:6] = 3
    volume = vs.Volume(labels, spacing=(1, 1, 1), kind="labels")
    path = tmp_path / f"labels{suffix}"
    vs.render(volume, size=200, figure=vs.Figure(dpi=20)).save(path)
    assert path.stat().st_size > 0 and b'="-' not in path.read_bytes()


def test_svg_of_another_program_has_no_scene(tmp_path: Path) -> None:
    for text in ("<svg/>", '<svg><image href="data:image/png;base64,AAA"/></svg>', '<svg><image href="a.png"/></svg>'):
        (tmp_path / "a.svg").write_text(text)
        with pytest.raises(BadInput, match="a.svg"):
            read_scene(tmp_path / "a.svg")


@pytest.mark.parametrize("background", ["black", "white"])
def test_words_are_set_off_from_what_is_behind_them(background: str) -> None:
    colour = colour_from_text(background)
    for figure in (Figure(), Figure(transparent=True), Figure(transparent=True, ink=(1.0, 1.0, 1.0))):
        ink, halo = figure.ink_on(colour)
        assert abs(sum(ink) - sum(halo)) == 3.0
        assert halo == colour or figure.transparent


def test_words_that_no_font_has_are_refused_but_for_svg() -> None:
    check_words(Figure(title="Ελένη, Đorđe, −5 °C"), Path("a.pdf"))
    check_words(Figure(title="頭"), Path("a.svg"))
    with pytest.raises(BadInput, match="do not have '頭'; write SVG"):
        check_words(Figure(title="頭"), Path("a.pdf"))


def test_render_and_movie_write_figures_of_a_size_in_print(head: Path, tmp_path: Path) -> None:
    person = Person(tmp_path)
    shown = ("--single", "--figure", "--size", "3x4cm", "--dpi", "120", "--text-size", "5")
    for name in ("a.png", "a.pdf"):
        done = person.runs("render", str(head), "-o", name, *shown, "--title", "Head")
        assert done.returncode == 0, done.stderr
    assert read_image(tmp_path / "a.png").shape[:2] == (189, 142)  # 4 and 3 cm at 120 pixels an inch
    with pypdfium2.PdfDocument(tmp_path / "a.pdf") as opened:
        assert opened[0].get_size() == pytest.approx((142 * 0.6, 189 * 0.6), abs=1e-2)
    done = person.runs("movie", str(head), "-o", "frames", "--frames", "2", *shown, "--transparent")
    assert done.returncode == 0, done.stderr
    frame = read_image(tmp_path / "frames" / "frame-00002.png")
    assert tuple(frame.shape) == (189, 142, 4) and frame[0, 0, 3] == 0
    assert SIZE[0] < read_scene(tmp_path / "frames" / "frame-00001.png").image.width == 142


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("-o", "a.jpg", "--transparent"), "JPEG cannot be transparent"),
        (("-o", "a.gif", "--figure"), "end the name in one of .png"),
        (("-o", "a.png", "--label", "nose"), "give TEXT@I,J,K"),
        (("-o", "a.png", "--size", "3cm x"), "as in 8.5cm or 8.5x12cm"),
    ],
)
def test_what_makes_no_figure_is_refused_before_anything_is_drawn(
    head: Path, tmp_path: Path, arguments: tuple[str, ...], line: str
) -> None:
    done = Person(tmp_path).runs("render", str(head), *arguments)
    assert done.returncode == 2 and line in done.stderr and done.stderr.count("\n") == 1
    assert not list(tmp_path.glob("a.*"))
