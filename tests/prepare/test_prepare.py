"""`volsplat prepare`: the numbers of a session, levels that are means, the same bytes whatever happens meanwhile."""

import errno
import fcntl
import gzip
import json
import math
import os
import resource
import shutil
import signal
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pytest
import torch
from hypothesis import assume, example, given
from hypothesis import strategies as st

from reference import level_means, level_mixtures, voxel_packets
from support.files.prepared import (
    LITTLE,
    ODD_DIMS,
    SKEWED,
    SMALL,
    Told,
    killed_after,
    packed_whole,
    prepare_small,
    store_of,
    tree,
    values_of,
    written,
)
from support.patience import PATIENCE, wait_until
from support.programs.programs import VOLSPLAT, Person
from support.scenes.arbitrary import geometries
from volsplat.client.session.single import SingleProcess
from volsplat.mapshade_server.held.packet_store import PacketStore, attributes_of, has_attributes, open_store
from volsplat.mapshade_server.prepare import Options
from volsplat.mapshade_server.prepare.command import window_from_option
from volsplat.mapshade_server.prepare.gradient_means import halved_gradients
from volsplat.mapshade_server.prepare.halving import halved, mean_type
from volsplat.mapshade_server.prepare.layout import (
    MIB,
    PROGRAM_BYTES,
    Layout,
    halved_axes,
    halved_geometry,
    memory_plan,
)
from volsplat.mapshade_server.readers.reading.volume_reader import SCALAR_TYPES, Voxels
from volsplat.protocol.description.scene import Quantise
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.rules.index_rules import (
    FIRST_TWO_FACED,
    ROUGH_NO_GRADIENT,
    TWO_FACED_DIRECTIONS,
    Quantisation,
)
from volsplat.protocol.rules.levels import factors_of
from volsplat.protocol.rules.packet_layout import DIRECTION_SHIFT
from volsplat.protocol.text.byte_sizes import bytes_from_option
from volsplat.protocol.text.errors import BadInput

EXACT_MEANS = 1e-12  # of some thousand numbers, in another order


def assert_levels_are_means(store: PacketStore, values: Voxels) -> None:
    """Every level packed as one, its values by the reference."""
    scalar_type, finer = values.dtype.name, None
    mixtures: list[torch.Tensor] = []
    table = torch.rand((65536, 2), dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    assert store.mixture(0) is None
    assert store.levels == tuple(SMALL.levels(store.description.geometry))
    for level, geometry in enumerate(store.levels):
        packed = torch.from_numpy(packed_whole(geometry, values, store.quantisation).astype(np.int64))
        found = torch.from_numpy(store.read(level, geometry.box).astype(np.int64))
        if finer is None:
            assert torch.equal(found, packed)
        else:
            scheme = store.quantisation.directions if level == 1 else "rough"
            assert level_means.is_with_gradients_of(finer, scheme, packed, found)
            mixtures.append(level_mixtures.mixture(finer, found))
            mixture = store.mixture(level)
            assert mixture is not None
            means = torch.from_numpy(mixture.means(table.numpy()))
            assert (means - level_mixtures.level_table(table, mixtures)).abs().max() <= EXACT_MEANS
        finer = found
        exact = torch.from_numpy(values.astype(np.float64))
        if level + 1 < len(store.levels):
            sides = level_means.sides_of(geometry.dims[::-1], store.levels[level + 1].dims[::-1])
            values = level_means.halved(exact, sides).numpy().astype(mean_type(scalar_type))
    assert store.levels[-1].box.voxels <= SMALL.coarsest
    assert all(geometry.box.voxels > SMALL.coarsest for geometry in store.levels[:-1])


@pytest.mark.parametrize("scalar_type", SCALAR_TYPES)
def test_all_levels_are_those_of_the_reference(scalar_type: str, tmp_path: Path) -> None:
    values = values_of(scalar_type)
    assert_levels_are_means(store_of(tmp_path, values), values)


@given(
    dims=st.tuples(st.integers(1, 40), st.integers(1, 40), st.integers(1, 40)),
    scalar_type=st.sampled_from(["uint8", "int16", "float32"]),
)
@example(dims=(37, 9, 9), scalar_type="uint8")  # has a direction on the border between two codes
@example(dims=(1, 1, 1), scalar_type="int16")  # becomes nothing but zeros, which Zarr would not write
def test_grids_of_any_size_are_prepared(
    dims: Index, scalar_type: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    values = values_of(scalar_type, dims)
    assume(np.isfinite(values).any())
    assert_levels_are_means(store_of(tmp_path_factory.mktemp("any"), values), values)


@given(normal=st.tuples(*3 * [st.floats(-1.0, 1.0)]).filter(lambda normal: math.hypot(*normal) > 0.1))
@example(normal=(0.0, 0.0, 1.0))
@example(normal=(1.0, -1.0, 0.0))
def test_a_thin_sheet_faces_both_ways_on_its_level_and_a_surface_does_not(normal: Vector) -> None:
    across = np.array(normal) / math.hypot(*normal)
    place = np.moveaxis(np.mgrid[:26, :26, :26], 0, -1)[..., ::-1] @ across
    place = place - place.mean()
    unit = Geometry((26, 26, 26), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    quantisation = Quantisation(window=(0.0, 100.0), strength_scale=1.0)
    sheet, surface = (
        halved_gradients(packed_whole(unit, values, quantisation), "octahedral") >> DIRECTION_SHIFT
        for values in (100.0 * np.exp(-np.square(place) / 2.0), 100.0 / (1.0 + np.exp(-2.0 * place)))
    )
    facing = sheet[(sheet >= FIRST_TWO_FACED) & (sheet < FIRST_TWO_FACED + TWO_FACED_DIRECTIONS)]
    directions = voxel_packets.directions("rough").numpy()[facing]
    assert len(facing) > 0 and (np.abs(directions @ across) > 0.9).all()
    assert ((surface < FIRST_TWO_FACED) | (surface == ROUGH_NO_GRADIENT)).all()


@pytest.mark.parametrize("scalar_type", ["uint8", "uint16", "float32"])
def test_the_numbers_are_those_of_a_session(scalar_type: str, tmp_path: Path) -> None:
    store = store_of(tmp_path, values_of(scalar_type))
    with SingleProcess(tmp_path / "volume.nrrd") as single:
        assert store.description == msgspec.structs.replace(single.volume.description, chunk=(1, 1, 1))
        assert store.survey == single.volume.survey
        assert store.density_counts == single.volume.density_counts
        assert store.strength_counts == single.volume.strength_counts
        assert store.quantisation == single.volume.quantisation(Quantise())


def test_window_and_directions_are_those_asked_for(tmp_path: Path) -> None:
    volume = written(tmp_path / "volume.nrrd", values_of("int16"))
    prepare_small(volume, tmp_path / "o.zarr", Options(window=(-20.0, 30.5), directions="paper", layout=SMALL))
    store = open_store(str(tmp_path / "o.zarr"))
    assert store.quantisation.window == (-20.0, 30.5) and store.quantisation.directions == "paper"
    assert_levels_are_means(store, values_of("int16"))


HALVED = st.tuples(st.integers(1, 2), st.integers(1, 2), st.integers(1, 2))


@given(dims=st.tuples(st.integers(1, 40), st.integers(1, 9), st.integers(1, 9)), factors=HALVED)
def test_means_of_noise_are_those_of_the_reference(dims: Index, factors: Index) -> None:
    values = np.random.default_rng(1).normal(size=dims)
    values[values > 1.5] = np.inf
    torch.testing.assert_close(
        torch.from_numpy(halved(values, factors)),
        level_means.halved(torch.from_numpy(values), factors[::-1]),
        equal_nan=True,
    )


@pytest.mark.parametrize(
    ("dims", "factors"),
    [((10, 12, 14), (2, 2, 1)), ((10, 1, 7), (2, 1, 1)), ((1, 12, 7), (1, 2, 1)), ((1, 1, 5), (1, 1, 2))],
)
def test_a_coarse_voxel_lies_in_the_middle_of_those_it_is_made_of(dims: Index, factors: Index) -> None:
    fine = Geometry(dims, SKEWED, (3.0, 4.0, 5.0))
    coarse = halved_geometry(fine)
    assert coarse.dims == tuple(-(-n // factor) for n, factor in zip(dims, factors, strict=True))
    ci, cj, ck = (2 if n > 3 else 0 for n in dims)
    middle = tuple(factor * at + 0.5 * (factor - 1) for at, factor in zip((ci, cj, ck), factors, strict=True))
    assert coarse.physical((float(ci), float(cj), float(ck))) == pytest.approx(fine.physical(middle))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("spacing", "factors"),
    [
        ((1.0, 1.0, 1.0), [(2, 2, 2)] * 3),
        ((1.0, 1.0, 1.3), [(2, 2, 2)] * 3),
        ((1.0, 1.0, 2.0), [(2, 2, 1), (2, 2, 2), (2, 2, 2)]),
        ((0.81, 0.81, 2.4), [(2, 2, 1), (2, 2, 1), (2, 2, 2)]),
        ((0.45, 0.45, 5.0), [(2, 2, 1)] * 3),
        ((8.0, 1.0, 2.0), [(1, 2, 1), (1, 2, 2), (1, 2, 2)]),
    ],
)
def test_thick_slices_are_not_halved_before_voxels_are_as_wide(spacing: Vector, factors: list[Index]) -> None:
    x, y, z = spacing
    geometry = Geometry((512, 512, 512), ((x, 0.0, 0.0), (0.0, y, 0.0), (0.0, 0.0, z)))
    for expected in factors:
        coarser = halved_geometry(geometry)
        assert factors_of(geometry, coarser) == halved_axes(geometry) == expected
        assert max(coarser.spacing) / min(coarser.spacing) <= max(max(spacing) / min(spacing), math.sqrt(2.0))
        geometry = coarser


@pytest.mark.parametrize(
    ("dims", "spacing", "levels"),
    [
        ((257, 256, 256), (1.0, 1.0, 1.0), [(129, 128, 128), (65, 64, 64)]),
        ((256, 256, 256), (1.0, 1.0, 1.0), [(128, 128, 128)]),
        ((512, 512, 28), (0.45, 0.45, 5.0), [(256, 256, 28)]),
        ((100000, 8, 8), (1.0, 1.0, 1.0), [(50000, 4, 4)]),
        ((200, 100, 100), (1.0, 1.0, 1.0), []),
    ],
)
def test_levels_end_at_what_is_cheap_to_draw(dims: Index, spacing: Vector, levels: list[Index]) -> None:
    x, y, z = spacing
    made = Layout().levels(Geometry(dims, ((x, 0.0, 0.0), (0.0, y, 0.0), (0.0, 0.0, z))))
    assert [level.dims for level in made[1:]] == levels


@given(geometries())
def test_levels_end_whatever_the_spacing(geometry: Geometry) -> None:
    levels = Layout(coarsest=2).levels(geometry)
    assert levels[-1].box.voxels <= 2
    assert all(math.prod(coarse.dims) < math.prod(fine.dims) for fine, coarse in pairwise(levels))


# -- the same bytes


def test_memory_changes_no_byte(tmp_path: Path) -> None:
    volume = written(tmp_path / "volume.nrrd", values_of("float64"))
    for name, memory in (("much", 1024 * MIB), ("some", PROGRAM_BYTES + MIB // 2), ("little", LITTLE.memory)):
        prepare_small(volume, tmp_path / f"{name}.zarr", Options(layout=SMALL, memory=memory))
    plans = {
        memory_plan(SMALL, ODD_DIMS, [8], memory) for memory in (1024 * MIB, PROGRAM_BYTES + MIB // 2, LITTLE.memory)
    }
    assert len(plans) == 3
    assert tree(tmp_path / "much.zarr") == tree(tmp_path / "some.zarr") == tree(tmp_path / "little.zarr")


def test_what_voxels_stand_for_depends_on_no_layout(tmp_path: Path) -> None:
    volume = written(tmp_path / "volume.nrrd", values_of("float32"))
    table = np.random.default_rng(1).random((65536, 1))
    means = []
    for brick, shard in ((8, 16), (8, 8), (16, 64)):
        out = tmp_path / f"{brick}-{shard}.zarr"
        prepare_small(volume, out, Options(layout=Layout(brick, shard, SMALL.coarsest)))
        mixture = open_store(str(out)).mixture(2)
        assert mixture is not None
        means.append(mixture.means(table))
    assert means[0].any() and all((other == means[0]).all() for other in means[1:])


@pytest.mark.parametrize("zipped", [False, True])
def test_killed_again_and_again_it_ends_with_the_same_bytes(zipped: bool, tmp_path: Path) -> None:
    volume = written(tmp_path / "volume.nrrd", values_of("int16"))
    if zipped:
        raw = volume.read_bytes()
        end = raw.index(b"\n\n") + 2
        volume.write_bytes(raw[:end].replace(b"encoding: raw", b"encoding: gzip") + gzip.compress(raw[end:]))
    prepare_small(volume, tmp_path / "whole.zarr")
    out = tmp_path / "killed.zarr"
    # While surveying, while packing, again and again, while checking, and never.
    runs = [killed_after(lines, volume, out) for lines in (1, 8, 14, 8, 9, 7, 20, 1000)]
    shares = [int(line.split()[1]) for told in runs for line in told if line.startswith("resuming")]
    assert len(set(shares)) == 5 and shares == sorted(shares) and shares[0] > 0
    assert tree(out) == tree(tmp_path / "whole.zarr")


def open_fails(out: Path) -> bool:
    try:
        open_store(str(out))
    except BadInput:
        return True
    return False


def test_a_store_that_was_ended_before_its_survey_is_called_unfinished(tmp_path: Path) -> None:
    class Ending(Told):
        def begin(self, stage: str, total: int) -> None:
            raise KeyboardInterrupt

    out = tmp_path / "o.zarr"
    with pytest.raises(KeyboardInterrupt):
        prepare_small(written(tmp_path / "volume.nrrd", values_of("int16")), out, told=Ending())
    assert not has_attributes(out)
    unfinished = "o.zarr: was not finished; run the `volsplat prepare` that began it from volume.nrrd once more"
    with pytest.raises(BadInput, match=unfinished):
        SingleProcess(out)
    person = Person(tmp_path)
    for command in (("info", "o.zarr"), ("render", "o.zarr", "-o", "o.png", "--workers", "1")):
        done = person.runs(*command)
        assert done.returncode == 2 and done.stderr.strip().endswith(unfinished), done.stderr
    prepare_small(tmp_path / "volume.nrrd", out)
    assert attributes_of(out).complete


def test_ctrl_c_leaves_a_store_that_the_same_command_finishes(tmp_path: Path) -> None:
    person = Person(tmp_path)
    assert person.runs("phantom", "shells", "--size", "140x500x40", "-o", "shells.nrrd").returncode == 0
    running = person.starts("prepare", "shells.nrrd", "shells.zarr")
    journal = tmp_path / "shells.zarr" / ".prepare" / "journal.json"
    wait_until(lambda: journal.exists() and json.loads(journal.read_bytes())["shards"], "begun")
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=PATIENCE)
    assert running.returncode == 130
    assert said.split("\n") == ["stopped; the same command goes on from here", "", "volsplat: interrupted", ""]
    with pytest.raises(BadInput, match="was not finished"):
        open_store(str(tmp_path / "shells.zarr"))
    again = person.runs("prepare", "shells.nrrd", "shells.zarr")
    resuming, done = again.stderr.splitlines()
    assert again.returncode == 0 and resuming.startswith("resuming: ") and resuming.endswith(" % done")
    assert done.startswith("shells.zarr: 140 x 500 x 40 voxels, 2 levels, window 0 to 255, in ")
    assert person.runs("prepare", "shells.nrrd", "whole.zarr").returncode == 0
    assert tree(tmp_path / "shells.zarr") == tree(tmp_path / "whole.zarr")
    once_more = person.runs("prepare", "shells.nrrd", "shells.zarr")
    assert once_more.returncode == 0 and "was prepared before" in once_more.stderr


class Spoiling(Told):
    """Spoils a shard, or removes it, once all are written."""

    def __init__(self, out: Path, remove: bool) -> None:
        super().__init__()
        self._out, self._remove = out, remove

    def begin(self, stage: str, total: int) -> None:
        super().begin(stage, total)
        shard = self._out / "0" / "c" / "1" / "0" / "1"
        if stage == "checking" and self._remove:
            shard.unlink()
        elif stage == "checking":
            raw = bytearray(shard.read_bytes())
            raw[200] ^= 1
            shard.write_bytes(raw)


@pytest.mark.parametrize("remove", [False, True])
def test_what_the_disk_spoilt_is_found_and_written_anew(remove: bool, tmp_path: Path) -> None:
    volume, out = written(tmp_path / "volume.nrrd", values_of("int16")), tmp_path / "spoilt.zarr"
    with pytest.raises(BadInput, match="1 of 35 shards came back from the disk other than they were written"):
        prepare_small(volume, out, told=Spoiling(out, remove))
    assert open_fails(out)
    told = Told()
    prepare_small(volume, out, told=told)
    assert told.notes == ["resuming: 81 % done"]
    prepare_small(volume, tmp_path / "whole.zarr")
    assert tree(out) == tree(tmp_path / "whole.zarr")


def test_progress_ends_where_it_was_said_to(tmp_path: Path) -> None:
    told = Told()
    prepare_small(written(tmp_path / "volume.nrrd", values_of("int16")), tmp_path / "o.zarr", told=told)
    assert list(told.stages) == ["surveying", "counting", "packing", "checking"]
    assert all(promised == done > 0 for promised, done in told.stages.values())
    told = Told()
    prepare_small(tmp_path / "volume.nrrd", tmp_path / "p.zarr", Options(layout=SMALL, verify=False), told)
    assert "checking" not in told.stages


# -- memory

MEASURED_RUN = """
import sys
from pathlib import Path
from volsplat.mapshade_server.prepare import Options, prepare
from volsplat.mapshade_server.prepare.layout import Layout
from volsplat.program.peak_memory import peak_memory

class Quiet:
    def note(self, text): pass
    def begin(self, stage, total): pass
    def advance(self, done): pass

print(peak_memory())
prepare(sys.argv[1], Path(sys.argv[2]), Options(layout=Layout(32, 64, 32**3), memory=int(sys.argv[3])), Quiet())
print(peak_memory())
"""


def test_memory_is_bounded_whatever_the_size(tmp_path: Path) -> None:
    memory = 168 * MIB
    dims = (320, 240, 304)
    sheet = np.random.default_rng(2).integers(0, 4000, (dims[1], dims[0])).astype(np.uint16)
    volume = tmp_path / "large_320x240x304_uint16.raw"
    with volume.open("wb") as file:
        for k in range(dims[2]):
            file.write((sheet + k).tobytes())
    command = [sys.executable, "-c", MEASURED_RUN, str(volume), str(tmp_path / "o.zarr"), str(memory)]
    done = subprocess.run(command, capture_output=True, encoding="utf-8", timeout=PATIENCE)
    assert done.returncode == 0, done.stderr
    before, most = map(int, done.stdout.split())
    assert before + volume.stat().st_size * 3 > memory, "sources and packets would fit"
    assert most <= memory


def test_too_little_memory_is_refused_with_what_is_needed(tmp_path: Path) -> None:
    volume = written(tmp_path / "volume.nrrd", values_of("uint16", (64, 64, 64)))
    with pytest.raises(BadInput, match=r"--memory: this volume needs at least \d+M"):
        prepare_small(volume, tmp_path / "o.zarr", Options(memory=100 * MIB))
    assert not (tmp_path / "o.zarr").exists()


# -- what is refused


@pytest.mark.parametrize("nothing", [np.nan, np.inf])
def test_a_volume_without_any_value_is_refused_and_nothing_is_written(nothing: float, tmp_path: Path) -> None:
    written(tmp_path / "volume.nrrd", np.full((9, 10, 11), nothing, np.float32))
    done = Person(tmp_path).runs("prepare", "volume.nrrd", "o.zarr")
    assert done.returncode == 2
    assert (
        done.stderr == "volsplat: volume.nrrd: no voxel has a value, all are NaN or infinite; export the volume again\n"
    )
    assert [path.name for path in tmp_path.iterdir()] == ["volume.nrrd"]


def test_a_source_that_is_changed_while_it_is_prepared_is_refused(tmp_path: Path) -> None:
    volume, out = written(tmp_path / "volume.nrrd", values_of("int16")), tmp_path / "o.zarr"

    class Touching(Told):
        def begin(self, stage: str, total: int) -> None:
            super().begin(stage, total)
            if stage == "packing":
                os.utime(volume, ns=(10**18, 10**18))

    with pytest.raises(BadInput, match="was replaced or changed while it was prepared"):
        prepare_small(volume, out, told=Touching())
    assert not attributes_of(out).complete


def test_another_source_and_other_options_are_refused(tmp_path: Path) -> None:
    volume, out = written(tmp_path / "volume.nrrd", values_of("int16")), tmp_path / "o.zarr"
    killed_after(30, volume, out)
    other = written(tmp_path / "other.nrrd", values_of("int16"))
    for finished in (False, True):
        if finished:
            prepare_small(volume, out)
        with pytest.raises(BadInput, match="was begun from volume.nrrd; delete it, or name another place"):
            prepare_small(other, out)
        with pytest.raises(BadInput, match="was begun with other options"):
            prepare_small(volume, out, Options(window=(0.0, 1.0), layout=SMALL))
        with pytest.raises(BadInput, match="was begun with other options"):
            prepare_small(volume, out, Options(directions="paper", layout=SMALL))
    os.utime(volume, ns=(1, 1))
    with pytest.raises(BadInput, match="was begun from volume.nrrd as it was before it changed"):
        prepare_small(volume, out)


def test_a_source_is_known_by_its_contents_wherever_it_lies(tmp_path: Path) -> None:
    volume, out = written(tmp_path / "volume.nrrd", values_of("int16")), tmp_path / "o.zarr"
    killed_after(30, volume, out)
    moved = tmp_path / "elsewhere" / "volume.nrrd"
    moved.parent.mkdir()
    shutil.move(volume, moved)
    told = Told()
    prepare_small(moved, out, told=told)
    assert told.notes and told.notes[0].startswith("resuming")
    shutil.copy2(moved, volume)
    prepare_small(volume, tmp_path / "whole.zarr")
    assert tree(out) == tree(tmp_path / "whole.zarr"), "its folder is not in the store"
    time_of_change = volume.stat().st_mtime_ns
    content = bytearray(volume.read_bytes())
    content[-1] ^= 1
    volume.write_bytes(content)
    os.utime(volume, ns=(time_of_change, time_of_change))
    with pytest.raises(BadInput, match=r"as it was before it changed \(its contents differ\); delete it"):
        prepare_small(volume, out)


def test_two_processes_do_not_prepare_the_same_store(tmp_path: Path) -> None:
    volume, out = written(tmp_path / "volume.nrrd", values_of("int16")), tmp_path / "o.zarr"
    (out / ".prepare").mkdir(parents=True)
    with (out / ".prepare" / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with pytest.raises(BadInput, match="is being prepared by another process"):
            prepare_small(volume, out)
    prepare_small(volume, out)


def test_a_file_system_without_locks_is_told_and_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def without_locks(descriptor: int, operation: int) -> None:
        raise OSError(errno.ENOSYS, "Function not implemented")

    volume, out = written(tmp_path / "volume.nrrd", values_of("int16")), tmp_path / "o.zarr"
    monkeypatch.setattr(fcntl, "flock", without_locks)
    told = Told()
    prepare_small(volume, out, told=told)
    assert attributes_of(out).complete
    assert f"{out}: its file system has no locks; see to it that nobody else prepares it meanwhile" in told.notes


def test_a_place_that_is_taken_is_left_alone(tmp_path: Path) -> None:
    volume = written(tmp_path / "volume.nrrd", values_of("int16"))
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "thesis.tex").write_text("years of work")
    for taken in ("folder", "volume.nrrd"):
        with pytest.raises(BadInput, match="is there already and is no packet store; name another place"):
            prepare_small(volume, tmp_path / taken)


@pytest.mark.parametrize("most", [2000, 60000])
def test_a_disk_that_refuses_is_named_and_the_work_is_taken_up(most: int, tmp_path: Path) -> None:
    written(tmp_path / "volume.nrrd", values_of("int16", (70, 66, 68)))
    command = [str(VOLSPLAT), "prepare", "volume.nrrd", "o.zarr"]
    limited = subprocess.run(
        command,
        cwd=tmp_path,
        capture_output=True,
        encoding="utf-8",
        timeout=PATIENCE,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most)),
    )
    assert (limited.returncode, limited.stderr) == (
        2,
        "volsplat: o.zarr: cannot be written (File too large); see to it, then run the same command again\n",
    )
    assert Person(tmp_path).runs("prepare", "volume.nrrd", "o.zarr").returncode == 0
    assert open_store(str(tmp_path / "o.zarr")).description.geometry.dims == (70, 66, 68)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere.nrrd", "o.zarr"], "nowhere.nrrd: there is no such file; check the path"),
        (["volume.nrrd", "o.zarr", "--window", "3,2"], "--window 3,2: LOW must be below HIGH"),
        (["volume.nrrd", "o.zarr", "--memory", "much"], "--memory much: give a size such as 800M or 4G"),
        (["volume.nrrd", "volume.nrrd/o.zarr"], "volume.nrrd/o.zarr: cannot be written (Not a directory)"),
        (["volume.nrrd"], "Missing argument 'OUT.zarr'"),
    ],
)
def test_mistakes_end_in_one_line(arguments: list[str], said: str, tmp_path: Path) -> None:
    written(tmp_path / "volume.nrrd", values_of("uint8", (4, 4, 4)))
    done = Person(tmp_path).runs("prepare", *arguments)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
    assert said in done.stderr and done.stderr.startswith("volsplat: ")


def test_the_command_is_listed(tmp_path: Path) -> None:
    assert "prepare " in Person(tmp_path).runs("--help").stdout
    usage = Person(tmp_path).runs("prepare", "--help").stdout
    assert usage.startswith("Usage: volsplat prepare [OPTIONS] VOLUME OUT.zarr")


def test_options_are_read() -> None:
    assert window_from_option("-1000, 2e3") == (-1000.0, 2000.0)
    assert [bytes_from_option("--memory", text) for text in ("1G", "1.5g", "800MB", "4096")] == [
        1 << 30,
        3 << 29,
        800 << 20,
        4096,
    ]
