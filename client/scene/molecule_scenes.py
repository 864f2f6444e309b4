"""Scenes of molecules: their density, atoms by type, and orbitals."""

from volsplat.client.histogram.density_histogram import landmarks, zero_position
from volsplat.client.histogram.subject import Subject, histogram_of
from volsplat.client.scene.class_scenes import CPK, classes_scene
from volsplat.client.scene.table_makers import GLOW, KEY_LIGHT, REFLECTION, both_sides, colours, dimmed, scalars
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.scene import Scene, Shading
from volsplat.protocol.description.shading_tables import CrossBar, Field, Tables


def molecules_scene(subject: Subject | None) -> Scene:
    """Emitted light by gradient strength brings out the atoms' boundaries, reflected light tells the density."""
    at = landmarks(histogram_of(subject))
    return Scene(
        tables=Tables(
            emit=colours((0.0, "#040a1e"), (0.25, "#0c2a58"), (0.6, "#5a2a68"), (1.0, "#a0562c")),
            refl=colours((at.object, "#2456a8"), (at.middle, "#3a9a78"), (at.core, "#c8a23c"), (1.0, "#d8d0c0")),
            opac=scalars((at.background, 0.0), (at.object, 0.12), (at.core, 0.6)),
        ),
        cross_bar=CrossBar(emit=Field.STRENGTH),
        shading=Shading(modulation=False, specular_power=30.0),
        light=KEY_LIGHT,
    )


def atoms_scene(subject: Subject | None) -> Scene:
    """The elements by the bands that the volume states; of a map, bands of density, whose peaks rise from carbon over
    nitrogen and oxygen to sulphur."""
    if subject is not None and subject.kind is Kind.ELEMENTS and (scene := classes_scene(subject)) is not None:
        return scene
    at = landmarks(histogram_of(subject))
    carbon, nitrogen, oxygen, sulphur = (at.object + (at.core - at.object) * n / 3 for n in range(4))
    edges = ((carbon + nitrogen) / 2, (nitrogen + oxygen) / 2, (oxygen + sulphur) / 2)
    bands = tuple(CPK[element] for element in ("C", "N", "O", "S"))
    points = [(0.0, bands[0])]
    for edge, below, above in zip(edges, bands[:-1], bands[1:], strict=True):
        points += [(edge, below), (edge, above)]
    return Scene(
        tables=Tables(
            emit=dimmed(colours(*points), GLOW),
            refl=dimmed(colours(*points), REFLECTION),
            opac=scalars((at.background, 0.0), (at.object, 0.2), (at.core, 0.8)),
        ),
        shading=Shading(modulation=False, specular_power=40.0),
        light=KEY_LIGHT,
    )


def orbital_scene(subject: Subject | None) -> Scene:
    """Soft lobes; of a signed wave function, each sign in its own colour."""
    zero = zero_position(histogram_of(subject))
    if zero is not None:
        return Scene(
            tables=Tables(
                emit=colours((0.0, "#2c6ccc"), (zero, "#0a0a10"), (1.0, "#cc7a2c")),
                refl=colours((zero, "#2c5890"), (zero, "#90602c")),
                opac=both_sides(zero, 0.06, 0.45),
            ),
            shading=Shading(modulation=False),
            light=KEY_LIGHT,
        )
    at = landmarks(histogram_of(subject))
    return Scene(
        tables=Tables(
            emit=colours((at.background, "#101c50"), (at.object, "#3050a8"), (at.core, "#d8e4f0")),
            refl=colours((0.0, "#506890")),
            opac=scalars((at.background, 0.0), (at.object, 0.03), (at.core, 0.5)),
        ),
        shading=Shading(modulation=False, specular_power=10.0),
        light=KEY_LIGHT,
    )
