"""The scene: what it refuses and how it says so, what its tables hold, and that it travels unchanged."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.scenes.arbitrary import plain_scene, situations
from tolerances import ROUNDING
from volsplat.protocol.description.scene import Image, Kernel, Light, Quantise, Reconstruction, Scene, Shading, View
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES, ColourTable, CrossBar, Field, ScalarTable
from volsplat.protocol.description.volume import Geometry


def encoded(changes: dict[str, object]) -> bytes:
    """The message of a plain scene with some parts replaced by raw values."""
    raw = msgspec.to_builtins(plain_scene())
    for path, value in changes.items():
        *parents, last = path.split(".")
        part = raw
        for name in parents:
            part = part[name]
        part[last] = value
    return msgspec.msgpack.encode(raw)


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("view.zoom", 0.0, "zoom must be"),
        ("view.zoom", -1.0, "zoom must be"),
        ("view.zoom", "closer", "zoom"),
        ("view.rotation", [0, 0, 0, 0], "rotation must not be all zeros"),
        ("view.rotation", [0, 0, 1], "view.rotation"),
        ("view.center", [0, float("nan"), 0], "center must be finite"),
        ("light.direction", [0, 0, 0], "direction must not be"),
        ("light.direction", [0, float("inf"), 0], "direction must be finite"),
        ("light.fixed_to", "ceiling", "light.fixed_to"),
        ("shading.specular_power", 0.0, "specular_power must be"),
        ("shading.specular_power", float("nan"), "specular_power must be"),
        ("shading.emitted", "yes", "shading.emitted"),
        ("cross_bar.emit", "temperature", "cross_bar.emit"),
        ("bounds.low", [0, 0], "bounds.low"),
        ("bounds.high", [1.5, 2, 2], "bounds.high"),
        ("reconstruction.kernel", "sinc", "reconstruction.kernel"),
        ("reconstruction.radius", 0.5, "radius must be"),
        ("reconstruction.radius", 5.0, "radius must be"),
        ("order", "sideways", "order"),
        ("refine.lit_from", "G", "refine.lit_from"),
        ("image.width", 0, "width must be"),
        ("image.height", 20000, "height must be"),
        ("image.background", [0, 0, 2], "background channel must be"),
        ("quantise.window", [5, 5], "window must rise"),
        ("quantise.window", [0, float("inf")], "window must be finite"),
        ("quantise.window", [0, 1e-320], "window must be neither too narrow nor too wide"),
        ("quantise.window", [-1.7e308, 1.7e308], "window must be neither too narrow nor too wide"),
        ("quantise.directions", "euler", "quantise.directions"),
        ("tables.opac.points", [], "at least one point"),
        ("tables.opac.points", [[0.0, 1.5]], "table value must be"),
        ("tables.opac.points", [[0.5, 1.0], [0.4, 1.0]], "rising order"),
        ("tables.opac.points", [[1.5, 1.0]], "point's position must be"),
        ("tables.emit.points", [[0.0, [0, 0, -0.1]]], "colour channel must be"),
        ("tables.emit.points", [[0.0, [0, 0]]], "tables.emit.points"),
        ("tables.emit.points", [[0.0, [0, 0, float("nan")]]], "colour channel must be"),
        ("view.tilt", 1.0, "tilt"),
        ("colour", 1.0, "colour"),
    ],
)
def test_a_bad_value_is_refused_with_its_place(path: str, value: object, words: str) -> None:
    with pytest.raises(msgspec.ValidationError) as refused:
        msgspec.msgpack.decode(encoded({path: value}), type=Scene)
    message = str(refused.value)
    assert words in message
    assert "\n" not in message
    part = path.split(".")[0]
    assert part in message


@given(
    situations(),
    st.sampled_from(Field),
    st.sampled_from(Kernel),
    st.floats(0, 1),
    st.tuples(st.floats(0, 1), st.floats(0, 1), st.floats(0, 1)),
)
def test_a_scene_travels_unchanged(
    situation: tuple[Scene, Geometry],
    field: Field,
    kernel: Kernel,
    opacity: float,
    colour: tuple[float, float, float],
) -> None:
    tables = plain_scene(opacity, colour).tables
    scene = msgspec.structs.replace(
        situation[0], tables=tables, cross_bar=CrossBar(refl=field), reconstruction=Reconstruction(kernel=kernel)
    )
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(scene), type=Scene) == scene
    assert msgspec.json.decode(msgspec.json.encode(scene), type=Scene) == scene


def test_a_scene_with_only_its_tables_has_every_default() -> None:
    scene = Scene(tables=plain_scene().tables)
    raw = {"tables": msgspec.to_builtins(scene.tables)}
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(raw), type=Scene) == scene
    assert (scene.view, scene.light, scene.shading) == (View(), Light(), Shading())
    assert (scene.image, scene.quantise) == (Image(), Quantise())


def test_a_scene_is_immutable() -> None:
    with pytest.raises(AttributeError):
        plain_scene().order = "ftb"  # type: ignore[assignment, misc]


points = st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), min_size=1, max_size=8).map(
    lambda drawn: tuple(sorted(drawn, key=lambda point: point[0]))
)


@given(points)
def test_table_runs_straight_between_its_points(drawn: tuple[tuple[float, float], ...]) -> None:
    entries = ScalarTable(points=drawn).entries()
    assert len(entries) == TABLE_ENTRIES
    for n, entry in enumerate(entries):
        position = n / 255
        below = [p for p in drawn if p[0] <= position]
        above = [p for p in drawn if p[0] > position]
        left, right = (below or above[:1])[-1], (above or below[-1:])[0]
        part = (position - left[0]) / (right[0] - left[0]) if right[0] > left[0] else 0.0
        assert entry == pytest.approx(left[1] + part * (right[1] - left[1]), abs=ROUNDING)


def test_two_points_at_one_position_make_a_step() -> None:
    entries = ScalarTable(points=((0.0, 0.2), (100 / 255, 0.2), (100 / 255, 0.9), (1.0, 0.9))).entries()
    assert entries[99] == pytest.approx(0.2, abs=ROUNDING)
    assert entries[100] == pytest.approx(0.9, abs=ROUNDING)


def test_a_freehand_table_is_kept_entry_by_entry() -> None:
    drawn = tuple((n / 255, (n * 37 % 256) / 255) for n in range(TABLE_ENTRIES))
    assert ScalarTable(points=drawn).entries() == pytest.approx([value for _, value in drawn], abs=ROUNDING)
    coloured = tuple((p, (v, 1 - v, v)) for p, v in drawn)
    entries = ColourTable(points=coloured).entries()
    assert entries == [pytest.approx(colour, abs=ROUNDING) for _, colour in coloured]


@pytest.mark.parametrize(
    ("dims", "matrix"),
    [((0, 4, 4), None), ((4, 4, 4), ((1.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, 0.0, 1.0)))],
)
def test_a_geometry_without_voxels_or_volume_is_refused(dims: tuple[int, int, int], matrix: object) -> None:
    raw = {"dims": dims} | ({"index_to_physical": matrix} if matrix else {})
    with pytest.raises(msgspec.ValidationError, match="voxel|span space"):
        msgspec.convert(raw, type=Geometry)
