"""Prepared volumes with a second scalar: its bytes, its levels, and the same bytes whatever happens meanwhile."""

from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

import tolerances
from reference import level_means
from support.files.prepared import LITTLE, SMALL, killed_after, packed_whole, prepare_small, tree
from support.files.reflection_files import mtz
from volsplat.client.session.session import Session
from volsplat.client.session.single import SingleProcess
from volsplat.mapshade_server.held.packet_store import PacketStore, open_store
from volsplat.mapshade_server.prepare import Options
from volsplat.mapshade_server.prepare.halving import halved_second
from volsplat.mapshade_server.prepare.layout import MIB, PROGRAM_BYTES
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels, read_scalars
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Image, Quantise, Refine, Scene, View
from volsplat.protocol.description.shading_tables import ColourTable, CrossBar, Field, ScalarTable, Tables
from volsplat.protocol.description.volume import Index
from volsplat.protocol.rules.packet_layout import NO_DATA_BIT

RESOLUTION = 1.0  # of 19 x 25 x 29 voxels
DEGREES = (0.0, 360.0)


@pytest.fixture(scope="module")
def volume(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The name of structure factors with their phases."""
    return f"{mtz(tmp_path_factory.mktemp('volumes') / 'made.mtz', resolution=RESOLUTION)}#frequency"


@pytest.fixture(scope="module")
def place(volume: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("stores") / "made.zarr"
    prepare_small(Path(volume), out)
    return out


@pytest.fixture(scope="module")
def store(place: Path) -> PacketStore:
    return open_store(str(place))


@pytest.fixture(scope="module")
def single(place: Path) -> Iterator[SingleProcess]:
    with SingleProcess(place) as single:
        yield single


@pytest.fixture(scope="module")
def unprepared(volume: str) -> Iterator[SingleProcess]:
    with SingleProcess(volume) as single:
        yield single


def both_scalars(volume: str) -> tuple[Voxels, Voxels]:
    reader = open_volume(volume)
    values, second = read_scalars(reader, reader.description.geometry.box)
    return values, second


# -- what is in the store


def test_all_levels_are_those_of_the_reference(volume: str, store: PacketStore) -> None:
    values, phases = both_scalars(volume)
    assert len(store.levels) == 4 and not store.quantisation.has_strength
    finer: torch.Tensor | None = None
    for level, geometry in enumerate(store.levels):
        packed = packed_whole(geometry, values, store.quantisation, phases, DEGREES)
        stored = store.read(level, geometry.box)
        expected = torch.from_numpy(packed.astype(np.int64))
        if finer is not None:
            expected = level_means.with_gradients_of(finer, "rough" if level > 1 else "octahedral", expected, False)
        finer = torch.from_numpy(stored.astype(np.int64))
        assert torch.equal(finer, expected)
        there = stored >> NO_DATA_BIT == 0
        assert len(np.unique(stored[there] >> 8 & 255)) > 64 < there.sum()
        exact = torch.from_numpy(values)
        if level + 1 < len(store.levels):
            sides = level_means.sides_of(geometry.dims[::-1], store.levels[level + 1].dims[::-1])
            phases = level_means.strongest(exact, torch.from_numpy(phases), sides).numpy()
            values = level_means.halved(exact, sides).numpy().astype(np.float32)


def test_the_numbers_are_those_of_a_session(store: PacketStore, unprepared: SingleProcess) -> None:
    volume = unprepared.volume
    assert store.description.second_scalar == volume.description.second_scalar == DEGREES
    assert (store.description.density_name, store.description.strength_name) == ("amplitude", "phase")
    assert store.survey == volume.survey
    assert store.density_counts == volume.density_counts
    assert store.strength_counts == volume.strength_counts
    assert store.quantisation == volume.quantisation(Quantise())


@given(
    dims=st.tuples(st.integers(1, 40), st.integers(1, 9), st.integers(1, 9)),
    scalar_type=st.sampled_from(["uint8", "int64", "float32"]),
)
def test_the_strongest_of_noise_is_that_of_the_reference(dims: Index, scalar_type: str) -> None:
    generator = np.random.default_rng(1)
    values = generator.integers(0, 5, dims).astype(scalar_type)  # of which many are equal
    if values.dtype.kind == "f":
        values[values == 4] = np.inf
        values[values == 3] = np.nan
    second = generator.uniform(*DEGREES, dims).astype(np.float32)
    chosen = halved_second(values, second)
    assert chosen.dtype == second.dtype
    expected = level_means.strongest(torch.from_numpy(values), torch.from_numpy(second))
    there = ~level_means.halved(torch.from_numpy(values)).isnan()
    assert torch.equal(torch.from_numpy(chosen)[there], expected[there])


# -- the same bytes


def test_memory_changes_no_byte(volume: str, place: Path, tmp_path: Path) -> None:
    for name, memory in (("some", PROGRAM_BYTES + MIB // 2), ("little", LITTLE.memory)):
        prepare_small(Path(volume), tmp_path / name, Options(layout=SMALL, memory=memory))
        assert tree(tmp_path / name) == tree(place)


def test_killed_again_and_again_it_ends_with_the_same_bytes(volume: str, place: Path, tmp_path: Path) -> None:
    # While copying, surveying and counting, while packing twice, and never.
    runs = [killed_after(lines, Path(volume), tmp_path / "killed") for lines in (1, 6, 12, 5, 6, 1000)]
    shares = [int(line.split()[1]) for told in runs for line in told if line.startswith("resuming")]
    assert len(set(shares)) == 3 and shares == sorted(shares) and shares[0] > 0
    assert tree(tmp_path / "killed") == tree(place)


# -- drawn


def by_phase(zoom: float, striding: bool = False) -> Scene:
    return Scene(
        tables=Tables(
            emit=ColourTable(points=((0.0, (1.0, 0.0, 0.0)), (1.0, (0.0, 1.0, 0.0)))),
            refl=ColourTable(points=((0.0, (0.0, 0.0, 0.0)),)),
            opac=ScalarTable(points=((0.3, 0.0), (0.3, 1.0))),
        ),
        cross_bar=CrossBar(emit=Field.STRENGTH),
        view=View(rotation=(0.2, 0.3, 0.1, 0.9), zoom=zoom),
        refine=Refine(striding=striding),
        image=Image(width=64, height=64),
    )


@pytest.mark.parametrize("step", [Step.A, Step.F])
def test_level_0_is_drawn_as_the_volume_itself(single: SingleProcess, unprepared: SingleProcess, step: Step) -> None:
    scene = by_phase(1.5, striding=True)
    drawn = single.render(scene, step)
    assert drawn[..., :2].amax(dim=(0, 1)).min() > 0
    assert torch.equal(drawn, unprepared.render(scene, step))
    found = single.probe(scene, 32.0, 32.0)
    assert found == unprepared.probe(scene, 32.0, 32.0) and found is not None


def test_a_session_draws_every_level_as_a_single_process(volume: str, place: Path, single: SingleProcess) -> None:
    _, phases = both_scalars(volume)
    half_a_byte = DEGREES[1] / 255 / 2 * (1 + tolerances.SAME_NUMBERS)
    with Session(place, workers=2) as session:
        for zoom in (1.5, 0.5, 0.25):
            drawn = session.render(by_phase(zoom))
            assert torch.equal(drawn, single.render(by_phase(zoom))) and drawn[..., :2].amax(dim=(0, 1)).min() > 0
            found = session.probe(by_phase(zoom), 32.0, 32.0)
            assert found is not None
            assert np.nanmin(np.abs(phases - found.strength)) <= half_a_byte


def test_the_paper_s_directions_change_no_phase(volume: str, store: PacketStore, tmp_path: Path) -> None:
    prepare_small(Path(volume), tmp_path / "o.zarr", Options(directions="paper", window=(0.0, 50.0), layout=SMALL))
    other = open_store(str(tmp_path / "o.zarr"))
    assert other.quantisation == msgspec.structs.replace(store.quantisation, directions="paper", window=(0.0, 50.0))
    for level, geometry in enumerate(store.levels):
        one, two = (each.read(level, geometry.box) for each in (store, other))
        assert (one >> 8 & 255 == two >> 8 & 255).all()
