"""Scenes of CT, placed by Hounsfield units: as the file states them, else by the peaks of air and soft tissue."""

from volsplat.client.histogram.density_histogram import CtScale, ct_scale
from volsplat.client.histogram.subject import Subject
from volsplat.client.scene.table_makers import KEY_LIGHT, colours, opacities, scalars
from volsplat.protocol.description.scene import Scene, Shading
from volsplat.protocol.description.shading_tables import CrossBar, Field, Tables


def _ct(subject: Subject | None) -> CtScale:
    """Hounsfield units on a table, as the volume has them or, if it tells nothing of them, as a CT would."""
    return subject.ct_or_peaks if subject else ct_scale(None)


def ct_skin_scene(subject: Subject | None) -> Scene:
    at = _ct(subject).place
    return Scene(
        tables=Tables(
            emit=colours((0.40, "#2a1811"), (0.78, "#966450")),
            refl=colours((0.0, "#6e4a3a")),
            opac=opacities((at(-550), 0.0), (at(-200), 1.0), (at(80), 1.0), (at(220), 0.0)),
            modu=scalars((0.03, 0.0), (0.12, 1.0)),  # inside the head nothing changes as much as at the skin
        ),
        cross_bar=CrossBar(emit=Field.SCREEN_Z),
        shading=Shading(specular_power=25.0),
        light=KEY_LIGHT,
    )


def ct_bone_scene(subject: Subject | None) -> Scene:
    at = _ct(subject).place
    return Scene(
        tables=Tables(
            emit=colours((at(150), "#241f17"), (at(1500), "#3a3528")),
            refl=colours((at(150), "#b09f80"), (at(1500), "#c4b898")),
            opac=opacities((at(150), 0.0), (at(450), 0.7), (at(1000), 0.9)),
        ),
        shading=Shading(modulation=False, specular_power=20.0),
        light=KEY_LIGHT,
    )


def surfaces_scene(subject: Subject | None) -> Scene:
    """Every boundary at once; the colour tells what lies behind it. Clip with `bounds` to look inside."""
    at = _ct(subject).place
    return Scene(
        tables=Tables(
            emit=colours((at(-700), "#0c1418"), (at(0), "#2e1d16"), (at(100), "#3a251c"), (at(600), "#5c5644")),
            refl=colours((at(-700), "#506878"), (at(-100), "#9a6c55"), (at(100), "#a87a5e"), (at(600), "#b0a88c")),
            opac=opacities((at(-700), 0.0), (at(-300), 0.5), (at(1000), 0.9)),
            modu=scalars((0.06, 0.0), (0.8, 1.0)),
        ),
        shading=Shading(two_sided=True),
        light=KEY_LIGHT,
    )


def ct_soft_tissue_scene(subject: Subject | None) -> Scene:
    """Fat is a faint veil and muscle and organs are solid, so that the skin does not hide them; bone is ivory."""
    at = _ct(subject).place
    return Scene(
        tables=Tables(
            emit=colours((at(-150), "#2a2210"), (at(0), "#301410"), (at(80), "#3c1812"), (at(300), "#4a4436")),
            refl=colours((at(-150), "#b09a50"), (at(-20), "#a84a3c"), (at(90), "#c8705a"), (at(300), "#e0d8c0")),
            opac=opacities((at(-160), 0.0), (at(-110), 0.01), (at(-30), 0.02), (at(15), 0.6), (at(300), 0.9)),
        ),
        shading=Shading(modulation=False, specular_power=30.0),
        light=KEY_LIGHT,
    )


def ct_lung_scene(subject: Subject | None) -> Scene:
    """Air in tissue, -950 to -500 HU, as a thin cloud; in it the walls of its vessels, in red.

    The skin passes through the same values and stays as a veil, which is all that a table can tell of it.
    """
    at = _ct(subject).place
    return Scene(
        tables=Tables(
            emit=colours((at(-950), "#16262e"), (at(-700), "#2a4656"), (at(-520), "#4a2420"), (at(-200), "#7a2a20")),
            refl=colours((at(-950), "#4a7488"), (at(-700), "#7fa8b8"), (at(-520), "#c07868"), (at(-200), "#e85840")),
            opac=opacities((at(-950), 0.0), (at(-880), 0.008), (at(-650), 0.012), (at(-350), 0.25), (at(-150), 0.0)),
        ),
        shading=Shading(modulation=False, two_sided=True),
        light=KEY_LIGHT,
    )


def ct_angio_scene(subject: Subject | None) -> Scene:
    """Vessels that contrast agent has filled, from 150 HU, in red; bone, which is denser yet, turns to ivory."""
    at = _ct(subject).place
    return Scene(
        tables=Tables(
            emit=colours((at(150), "#3a0806"), (at(350), "#4a1008"), (at(550), "#2e291e"), (at(1200), "#3a3528")),
            refl=colours((at(150), "#b02018"), (at(350), "#e04830"), (at(550), "#b8aa88"), (at(1200), "#c4b898")),
            opac=opacities((at(130), 0.0), (at(220), 0.7), (at(350), 0.9)),
        ),
        shading=Shading(modulation=False, specular_power=30.0),
        light=KEY_LIGHT,
    )
