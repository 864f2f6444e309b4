"""The scene of a single slice: a picture in greys, as image viewers and radiologists have it."""

from volsplat.client.histogram.density_histogram import LAST
from volsplat.client.histogram.subject import Subject
from volsplat.client.scene.table_makers import colours, scalars
from volsplat.protocol.description.scene import Scene, Shading
from volsplat.protocol.description.shading_tables import Tables

FLESH_HU = (-160.0, 240.0)  # what radiologists window soft tissue to
ENDS = 0.01  # of the pixels are black, and as many white


def slice_scene(subject: Subject) -> Scene:
    """Black to white over what nearly all pixels are, or over soft tissue in a CT; nothing is lit."""
    values, at = subject.values, subject.histogram.position
    if subject.ct is not None:
        black, white = (subject.ct.position(hounsfield) for hounsfield in FLESH_HU)
    else:
        black, white = at(values.percentile(ENDS)), at(values.percentile(1 - ENDS))
    black = min(black, (LAST - 1) / LAST)
    white = max(white, black + 1 / LAST)
    return Scene(
        tables=Tables(
            emit=colours((black, "#000000"), (white, "#ffffff")),
            refl=colours((0.0, "#000000")),
            opac=scalars((0.0, 1.0)),
        ),
        shading=Shading(diffuse=False, specular=False, modulation=False),
    )
