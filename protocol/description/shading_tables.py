"""The four shading tables (paper: "Shading"), and the packet fields that index them through the cross-bar."""

from enum import StrEnum
from typing import Annotated

from volsplat.protocol.description.colours import COLOUR_ALLOWED, Colour
from volsplat.protocol.description.scene_key import Key, Part, PartOf, Section, check_within
from volsplat.protocol.description.table_points import check_positions, interpolated

TABLE_ENTRIES = 256


class Field(StrEnum):
    """A packet field that can index a table through the cross-bar; each is 8 bits (see index_rules)."""

    DENSITY = "density"
    STRENGTH = "strength"
    GRADIENT_I = "gradient-i"
    GRADIENT_J = "gradient-j"
    GRADIENT_K = "gradient-k"
    SCREEN_X = "screen-x"
    SCREEN_Y = "screen-y"
    SCREEN_Z = "screen-z"
    GRID_I = "grid-i"
    GRID_J = "grid-j"
    GRID_K = "grid-k"


# Those that are a matter of an axis, in its order.
GRADIENT_FIELDS = (Field.GRADIENT_I, Field.GRADIENT_J, Field.GRADIENT_K)
SCREEN_FIELDS = (Field.SCREEN_X, Field.SCREEN_Y, Field.SCREEN_Z)
GRID_FIELDS = (Field.GRID_I, Field.GRID_J, Field.GRID_K)


class ColourTable(Part, frozen=True):
    """256 colours, given as points (position 0..1, colour) that are joined by straight lines.

    Positions must not fall; two points at one position make a step. Before the first and after the last point
    the table is constant. A freehand table is one point for each entry, at n / 255.
    """

    points: Annotated[
        tuple[tuple[float, Colour], ...],
        Key(
            "",
            PartOf("tables"),
            allowed=f"[[position, colour], ...], positions 0 to 1 in rising order, colours {COLOUR_ALLOWED}",
        ),
    ]

    def __post_init__(self) -> None:
        check_positions([position for position, _ in self.points])
        for _, colour in self.points:
            for channel in colour:
                check_within("a colour channel", channel)

    def entries(self) -> list[Colour]:
        channels = [interpolated([(p, c[n]) for p, c in self.points], TABLE_ENTRIES) for n in range(3)]
        return list(zip(*channels, strict=True))


class ScalarTable(Part, frozen=True):
    """256 opacities 0..1, given as points (position 0..1, value); see ColourTable."""

    points: Annotated[
        tuple[tuple[float, float], ...],
        Key("", PartOf("tables"), allowed="[[position, value], ...], positions 0 to 1 in rising order, values 0 to 1"),
    ]

    def __post_init__(self) -> None:
        check_positions([position for position, _ in self.points])
        for _, value in self.points:
            check_within("a table value", value)

    @property
    def greatest(self) -> float:
        """No entry is greater."""
        return max(value for _, value in self.points)

    def entries(self) -> list[float]:
        return interpolated(list(self.points), TABLE_ENTRIES)


class Tables(Part, frozen=True):
    """The four shading tables (paper: "Shading")."""

    emit: Annotated[ColourTable, Section("The colour that a sample gives off by itself.", "emitted colour")]
    refl: Annotated[
        ColourTable,
        Section(
            "The colour that a sample reflects: times L.G for diffuse, times H.G to a power for specular light.",
            "reflected colour",
        ),
    ]
    opac: Annotated[
        ScalarTable, Section("The opacity of a sample for a thickness of one reference spacing.", "opacity")
    ]
    modu: Annotated[
        ScalarTable,
        Section(
            "A factor on that opacity: a ramp over gradient strength brings out surfaces, one over screen-z\n"
            "makes a depth cue.",
            "modulation of the opacity",
        ),
    ] = ScalarTable(points=((0.0, 1.0),))


class CrossBar(Part, frozen=True):
    """Which packet field indexes each table."""

    emit: Annotated[Field, Key("The field that chooses the emitted colour.", PartOf("cross-bar"))] = Field.DENSITY
    refl: Annotated[Field, Key("The field that chooses the reflected colour.", PartOf("cross-bar"))] = Field.DENSITY
    opac: Annotated[Field, Key("The field that chooses the opacity.", PartOf("cross-bar"))] = Field.DENSITY
    modu: Annotated[
        Field,
        Key("The field that chooses the factor on the opacity.", PartOf("cross-bar")),
    ] = Field.STRENGTH
