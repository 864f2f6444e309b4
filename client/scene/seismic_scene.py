"""The scene of seismic amplitudes: reflections of either sign, so opaque that the survey's faces are sections of it."""

from volsplat.client.histogram.density_histogram import zero_position
from volsplat.client.histogram.subject import Subject
from volsplat.client.scene.table_makers import KEY_LIGHT, both_sides, colours
from volsplat.protocol.description.scene import Scene, Shading
from volsplat.protocol.description.shading_tables import Tables


def seismic_scene(subject: Subject | None) -> Scene:
    zero = zero_position(subject.histogram if subject else None)
    zero = 0.5 if zero is None else zero
    return Scene(
        tables=Tables(
            emit=colours((0.0, "#2858d8"), (zero, "#c8c4bc"), (1.0, "#d83828")),
            refl=colours((0.0, "#404040")),
            opac=both_sides(zero, 0.1, 0.95),
        ),
        shading=Shading(modulation=False),
        light=KEY_LIGHT,
    )
