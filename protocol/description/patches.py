"""Patches of the plane of density by gradient strength: a 2-D table, as a scene has it.

A patch is a trapezium whose lower and upper side lie at two strengths; rectangles and triangles are such, too. What
patches give at an entry of the table is worked out by the kernels (kernels/patch_table.h).
"""

import math
from typing import Annotated, Literal

import msgspec

from volsplat.protocol.description.scene_key import Key, Part, PartOf, check_within

MOST_PATCHES = 64
PLANE_ENTRIES = 65536  # at density | strength << 8
COUNTS_BYTES = 8 * PLANE_ENTRIES  # of a number of voxels for each

_COLOUR = '"#rrggbb", a name of CSS or [r, g, b]'
NO_COLOUR = (0.0, 0.0, 0.0)
_IN_EDITOR = PartOf("patches")


class Patch(Part, frozen=True):
    """Positions are 0..1 over the window of densities, and over the range of strengths."""

    density: Annotated[tuple[float, float], Key("Its left and right end at the lower strength.", _IN_EDITOR)]
    strength: Annotated[tuple[float, float], Key("Its lower and upper side.", _IN_EDITOR)] = (0.0, 1.0)
    top: Annotated[
        tuple[float, float] | Literal["same"], Key("Its left and right end at the upper strength.", _IN_EDITOR)
    ] = "same"
    soft: Annotated[
        float, Key("How far its rim reaches inwards, over which the opacity rises: 1 is to the middle.", _IN_EDITOR)
    ] = 0.5
    opacity: Annotated[float, Key("For a thickness of one reference spacing, within the rim.", _IN_EDITOR)] = 0.5
    emit: Annotated[
        tuple[float, float, float],
        Key("The colour that a sample gives off by itself.", _IN_EDITOR),
    ] = NO_COLOUR
    refl: Annotated[tuple[float, float, float], Key("The colour that a sample reflects.", _IN_EDITOR)] = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        for name in ("density", "top", "strength"):
            ends = getattr(self, name)
            if isinstance(ends, str):
                continue
            for end in ends:
                check_within(f"{name} of a patch", end)
            if ends[0] > ends[1] or (name == "strength" and ends[0] == ends[1]):
                raise ValueError(f"{name} of a patch must rise, not {list(ends)}")
        for name in ("soft", "opacity"):
            check_within(f"{name} of a patch", getattr(self, name))
        for name in ("emit", "refl"):
            for channel in getattr(self, name):
                check_within(f"{name} of a patch", channel)

    @property
    def ends(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Left and right at the lower strength, then at the upper."""
        return self.density, self.density if isinstance(self.top, str) else self.top

    @property
    def numbers(self) -> tuple[float, ...]:
        """As the kernels take them."""
        lower, upper = self.ends
        return (*lower, *upper, *self.strength, self.soft, self.opacity, *self.emit, *self.refl)


Patches = tuple[Patch, ...]


class Plane(Part, frozen=True):
    """The 2-D table; without patches there is none."""

    patches: Annotated[
        Patches,
        Key(
            "What can be seen, by density and gradient strength. Positions are 0 to 1, as in tables: density over the"
            " window, strength over its range (or the second value in its place).\nA patch reaches from density[0] to"
            " density[1] at strength[0], and from top[0] to top[1] at strength[1]. Its opacity rises from 0 at its rim"
            " to the full one over the share `soft` of the way to its middle, but not at a side that lies at 0 or"
            " 1.\nWhere patches overlap they let pass what both would, and mix their colours by their opacities.",
            PartOf("patches"),
            allowed="[{ density = [left, right], strength = [low, high], top = [left, right], soft = 0.5,"
            f" opacity = 0.5, emit = colour, refl = colour }}, ...], numbers 0 to 1, colours {_COLOUR}; all but density"
            " may be left out",
        ),
    ] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.patches) > MOST_PATCHES:
            raise ValueError(f"patches are {len(self.patches)}, more than {MOST_PATCHES}")

    @property
    def greatest(self) -> float:
        """No opacity of the table is greater."""
        return greatest_opacity(self.patches)

    @property
    def dark(self) -> bool:
        """Whether there are patches, and none of them emits light."""
        return bool(self.patches) and all(max(patch.emit) == 0.0 for patch in self.patches)


def colourless(patches: Patches) -> Patches:
    """What of patches decides the opacity."""
    return tuple(msgspec.structs.replace(patch, emit=NO_COLOUR, refl=NO_COLOUR) for patch in patches)


def greatest_opacity(patches: Patches) -> float:
    return 1.0 - math.prod(1.0 - patch.opacity for patch in patches)
