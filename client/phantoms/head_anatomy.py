"""The solids of the head phantom, in mm: x to the left, y backwards, z upwards, the middle of the grid at 0.

Left and right differ, so that a mirrored picture is noticed: the left frontal sinus is larger, the left ventricle
is wider, the nasal septum is bent, and the left ear lobe bears a bead of metal.
"""

import math

from volsplat.client.phantoms.solids import Ellipsoid, RoundCone, Solid, both_sides

FIELD_OF_VIEW = (192.0, 256.0, 226.0)

SKIN: tuple[Solid, ...] = (
    Ellipsoid((0, 12, 29), (75, 93, 78)),  # cranium
    Ellipsoid((0, -34, -14), (60, 53, 62)),  # face
    Ellipsoid((0, -34, -60), (54, 47, 38)),  # jaw
    Ellipsoid((0, -76, -85), (16, 13, 12)),  # chin
    *both_sides(
        Ellipsoid((38, -26, -16), (28, 42, 30)),  # temples and cheek bones
        RoundCone((10, -72, 20), (42, -62, 19), 11, 10),  # brows
    ),
    RoundCone((0, 26, -40), (0, 36, -150), 46, 54),  # neck
)
SKIN_BLEND = 14.0

FEATURES: tuple[Solid, ...] = (
    RoundCone((0, -80, 14), (0, -101, -27), 7, 8.5),  # nose
    *both_sides(Ellipsoid((11, -91, -31), (7.5, 9, 6.5))),  # its wings
    RoundCone((-15, -83, -54), (15, -83, -54), 5.0, 5.0),  # lips
    RoundCone((-12, -82, -64), (12, -82, -64), 5.8, 5.8),
)
FEATURES_BLEND = 7.0

EYE_HOLLOWS: tuple[Solid, ...] = both_sides(Ellipsoid((31, -92, 1), (17, 18, 11)))
EYELIDS: tuple[Solid, ...] = both_sides(Ellipsoid((31, -69, 1), (14, 13.5, 10)))
MOUTH: tuple[Solid, ...] = (Ellipsoid((0, -92, -59), (21, 14, 2.0)),)
NOSTRILS: tuple[Solid, ...] = both_sides(RoundCone((6.5, -96, -40), (5, -84, -26), 3.6, 3.4))

EARS: tuple[Solid, ...] = both_sides(
    RoundCone((69, 14, -6), (76, 24, -4), 6, 4),
    Ellipsoid((73, 18, -5), (5.5, 16, 22)),
    Ellipsoid((69, 12, -27), (5.5, 9, 10)),  # lobes
)
EAR_HOLLOWS: tuple[Solid, ...] = both_sides(Ellipsoid((80, 13, -7), (6, 8, 13)))
EAR_BEAD: tuple[Solid, ...] = (Ellipsoid((74, 11, -37), (4.5, 4.5, 4.5)),)  # left only

SKULL_OUTSIDE: tuple[Solid, ...] = (Ellipsoid((0, 12, 30), (68.5, 86.5, 72)),)
SKULL_INSIDE: tuple[Solid, ...] = (Ellipsoid((0, 12, 31), (62, 79.5, 65)),)
SKULL_BASE = -20.0  # z of its inner face
SKULL_BASE_THICKNESS = 7.0
FORAMEN_MAGNUM: tuple[Solid, ...] = (RoundCone((0, 34, -10), (0, 36, -40), 15, 13),)

FACE_BONES: tuple[Solid, ...] = (
    Ellipsoid((0, -66, 23), (36, 15.5, 20)),  # frontal bone
    Ellipsoid((0, -50, -10), (22, 26, 34)),  # between the orbits, and round the nose
    *both_sides(
        RoundCone((8, -74, 18), (46, -60, 18), 6.5, 6.5),  # upper rims of the orbits
        RoundCone((46, -60, 18), (51, -54, -8), 6.5, 6),  # outer rims
        RoundCone((48, -54, 14), (58, -20, 14), 6, 6),  # to the temples
        RoundCone((16, -72, -13), (50, -56, -14), 5.5, 7.5),  # lower rims and cheek bones
        RoundCone((52, -54, -15), (60, -4, -14), 5, 4.5),  # zygomatic arches
        Ellipsoid((22, -50, -30), (23, 26, 20)),  # maxillae
        RoundCone((52, 22, -20), (49, 20, -38), 9, 5),  # mastoids
    ),
    RoundCone((0, -76, 14), (0, -87, -3), 4.5, 4),  # nasal bones
    Ellipsoid((0, -48, -44), (31, 30, 7)),  # palate
)
FACE_BONES_BLEND = 5.0
ORBITS: tuple[Solid, ...] = both_sides(RoundCone((31, -82, 3), (17, -36, 3), 17, 4))
PEAR_OPENING: tuple[Solid, ...] = (
    RoundCone((0, -88, -10), (0, -66, -10), 6, 5),
    RoundCone((0, -88, -27), (0, -66, -27), 12, 9),
)

_JAW_JOINT_TO_CHIN = (
    (49.0, -2.0, -22.0),
    (46.0, -10.0, -60.0),
    (40.0, -34.0, -76.0),
    (25.0, -62.0, -84.0),
    (0.0, -73.0, -87.0),
)
MANDIBLE: tuple[Solid, ...] = both_sides(
    *(RoundCone(a, b, 6.5, 6.5) for a, b in zip(_JAW_JOINT_TO_CHIN, _JAW_JOINT_TO_CHIN[1:], strict=False)),
    RoundCone((47, -12, -34), (44, -22, -62), 5.5, 7),
    RoundCone((46, -26, -32), (44, -24, -60), 4, 6),
    RoundCone((43, -26, -66), (25, -58, -75), 6, 5.5),
    RoundCone((25, -58, -75), (0, -70, -77), 5.5, 5.5),
)


def _teeth() -> tuple[Solid, ...]:
    """Two rows of fourteen on the dental arch."""
    rows: list[Solid] = []
    for row_z, width in ((-53.0, 28.0), (-65.0, 26.0)):
        for n in range(14):
            angle = math.radians(-84 + 168 * n / 13)
            middle = (width * math.sin(angle), -40 - 35 * math.cos(angle), row_z)
            rows.append(Ellipsoid(middle, (3.0, 3.4, 6.5)))
    return tuple(rows)


TEETH = _teeth()

VERTEBRAE: tuple[Solid, ...] = tuple(
    solid
    for n in range(6)
    for solid in (
        Ellipsoid((0, 24 + n, -38 - 16.5 * n), (15, 12, 7)),
        RoundCone((0, 56 + n, -42 - 16.5 * n), (0, 72 + n, -47 - 16.5 * n), 5, 4),
        *both_sides(
            RoundCone((14, 32 + n, -39 - 16.5 * n), (11, 48 + n, -41 - 16.5 * n), 5.5, 5),
            RoundCone((11, 48 + n, -41 - 16.5 * n), (0, 58 + n, -42 - 16.5 * n), 5, 5),
        ),
    )
)
SPINAL_CORD: tuple[Solid, ...] = (
    RoundCone((0, 34, -20), (0, 43, -42), 9, 7.5),
    RoundCone((0, 43, -42), (0, 49, -150), 7.5, 7),
)

AIR_SPACES: tuple[Solid, ...] = (
    Ellipsoid((14, -70.5, 25), (14, 3.8, 10)),  # frontal sinuses: the left is larger
    Ellipsoid((-10, -70.5, 21), (8, 3.6, 6)),
    *both_sides(
        Ellipsoid((28, -50, -26), (13, 15, 13)),  # maxillary sinuses
        Ellipsoid((8, -50, 1), (5, 16, 8)),  # ethmoid cells
        *(Ellipsoid((50 + 4 * (n % 2), 18 + 4 * (n // 2), -17 - 5 * (n % 3)), (3, 3, 3)) for n in range(6)),  # mastoids
    ),
    Ellipsoid((6, -50, -18), (4.2, 30, 18)),  # nasal cavity, its septum bent to the right
    Ellipsoid((-8.5, -50, -19), (5.2, 30, 16)),
    Ellipsoid((0, -22, -10), (12, 11, 8)),  # sphenoid sinus
    RoundCone((0, -18, -24), (0, -8, -76), 9, 8),  # throat
    RoundCone((0, -10, -84), (0, -4, -150), 9, 9),  # windpipe
    Ellipsoid((0, -42, -57), (20, 24, 2.6)),  # mouth
)

EAR_CANALS: tuple[Solid, ...] = both_sides(RoundCone((76, 12, -8), (48, 12, -10), 3.4, 3.0))

BRAIN: tuple[Solid, ...] = both_sides(Ellipsoid((25, 10, 34), (34, 75, 60)))
FISSURE = (1.6, 26.0)  # between the hemispheres: half its width, and the z of its floor
CEREBELLUM: tuple[Solid, ...] = both_sides(Ellipsoid((19, 52, -5), (27, 26, 15)))
BRAIN_STEM: tuple[Solid, ...] = (RoundCone((0, 22, 14), (0, 35, -30), 12, 9),)
VENTRICLES: tuple[Solid, ...] = (
    RoundCone((9, -30, 40), (13, 4, 49), 9, 9),  # the left one is wider
    RoundCone((13, 4, 49), (23, 40, 38), 9, 9.5),
    RoundCone((23, 40, 38), (35, 20, 12), 9.5, 6),
    RoundCone((-8, -29, 40), (-11, 4, 48), 6.5, 6),
    RoundCone((-11, 4, 48), (-20, 38, 38), 6, 7),
    RoundCone((-20, 38, 38), (-33, 20, 14), 7, 5),
    Ellipsoid((0, 4, 24), (3.6, 14, 11)),  # third
    Ellipsoid((0, 42, -2), (8, 6, 8)),  # fourth
)
EYES: tuple[Solid, ...] = both_sides(Ellipsoid((31, -67, 2), (12.5, 12.5, 12.5)))
