"""What OME-XML says of the images in a TIFF file (docs.openmicroscopy.org/ome-model): steps, units, channels, files."""

from dataclasses import dataclass
from xml.etree import ElementTree

from volsplat.protocol.text.length_units import length_unit

DEFAULT_UNIT = "µm"  # of OME, if PhysicalSizeXUnit is left out
AXES = "XYZ"

StatedSteps = tuple[float | None, float | None, float | None]  # of a pixel's width and height, and between slices


@dataclass(frozen=True)
class OmeImage:
    """One image. Steps are in `unit`, all three; None if the file states none."""

    name: str
    size: tuple[int, int]
    steps: StatedSteps
    unit: str
    channels: tuple[str, ...]
    files: tuple[str, ...]  # that hold its planes, beside the file that was opened


@dataclass(frozen=True)
class OmeMetadata:
    images: tuple[OmeImage, ...]
    kept_in: str  # the file that holds the metadata instead, "" if they are here

    def of(self, number: int, name: str, size: tuple[int, int]) -> OmeImage | None:
        """The image that a library calls so, as the `number`th of those it could read."""
        alike = [image for image in self.images if image.size == size]
        named = [image for image in alike if image.name == name]
        if number < len(self.images) and self.images[number] in alike:
            return self.images[number]
        return named[0] if len(named) == 1 else None


def ome_metadata(xml: str) -> OmeMetadata:
    """Reads OME-XML; nothing of damaged XML."""
    try:
        root = ElementTree.fromstring(xml)
    except ElementTree.ParseError:
        return OmeMetadata((), "")
    kept_in = next((element.get("MetadataFile", "") for element in root.iterfind("{*}BinaryOnly")), "")
    pixels = ((image, one) for image in root.iterfind("{*}Image") for one in image.iterfind("{*}Pixels"))
    return OmeMetadata(tuple(_image(image, one) for image, one in pixels), kept_in)


def _image(image: ElementTree.Element, pixels: ElementTree.Element) -> OmeImage:
    names = [pixels.get(f"PhysicalSize{axis}Unit", DEFAULT_UNIT) for axis in AXES]
    stated = [_number(pixels.get(f"PhysicalSize{axis}")) for axis in AXES]
    shown = length_unit(names[0])
    steps: list[float | None] = []
    for step, name in zip(stated, names, strict=True):
        unit = length_unit(name)
        if step is None or name == names[0]:  # which may be a unit of no known length, as "pixel"
            steps.append(step)
        else:
            steps.append(step * unit.metres / shown.metres if unit is not None and shown is not None else None)
    return OmeImage(
        name=image.get("Name", ""),
        size=(int(_number(pixels.get("SizeX")) or 0), int(_number(pixels.get("SizeY")) or 0)),
        steps=(steps[0], steps[1], steps[2]),
        unit=shown.symbol if shown is not None and steps[0] is not None else "",
        channels=tuple(channel.get("Name", "") for channel in pixels.iterfind("{*}Channel")),
        files=tuple(dict.fromkeys(uuid.get("FileName", "") for uuid in pixels.iterfind("{*}TiffData/{*}UUID"))),
    )


def _number(text: str | None) -> float | None:
    try:
        return None if text is None else float(text)
    except ValueError:
        return None
