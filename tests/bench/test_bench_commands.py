"""The benchmarks as a person meets them: real runs on tiny volumes, their files, and one line for each mistake."""

import re
import signal
from importlib.util import find_spec
from pathlib import Path
from random import Random
from typing import cast

import click
import msgspec
import pytest
import torch

from support.files.images import read_image
from support.pages.browser import chromium_executable
from support.patience import PATIENCE, wait_until
from support.programs.hand_started import free_port
from support.programs.programs import Person
from volsplat.bench import renderers
from volsplat.bench.commands.aborts_command import abort_times
from volsplat.bench.commands.command import SUMMARIES, bench
from volsplat.bench.renderers import opened_rows, session_of_machines
from volsplat.bench.scaling.thread_shares import THREADS_OF_PROCESS
from volsplat.bench.tables.record import Record, read_record
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.scene.presets import preset_scene
from volsplat.client.session.bottleneck import bottleneck
from volsplat.client.session.frame_report import PAPER_SECONDS, StepReport, report_of
from volsplat.client.session.session import Session
from volsplat.client.session.single import SingleProcess
from volsplat.program import extras
from volsplat.program.this_machine import this_machine
from volsplat.protocol.description.machine import Machine
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.rules.refinement import PAPER_STEPS
from volsplat.protocol.text.errors import BadInput, PeerLost, VolsplatError

INTERRUPTED = 130
PHANTOM = ("--phantom", "shells:24")


@pytest.fixture
def person(tmp_path: Path) -> Person:
    return Person(tmp_path)


def measured(person: Person, command: str, *options: str, plot: bool = False) -> tuple[Record, str, str]:
    """The record, the Markdown and what was printed."""
    files = ["--json", "found.json", "--markdown", "found.md", *(["--plot", "found.png"] if plot else [])]
    done = person.runs("bench", command, *options, *files)
    assert done.returncode == 0, done.stderr
    if plot:
        assert read_image(person.folder / "found.png").shape[2] >= 3
    wait_until(lambda: not person.servers(), "without servers")  # those started by hand end after the client
    assert not [path for path in person.folder.iterdir() if path.name.startswith(".")]
    return (
        read_record(person.folder / "found.json"),
        (person.folder / "found.md").read_text(encoding="utf-8"),
        done.stdout,
    )


needs_matplotlib = pytest.mark.skipif(find_spec("matplotlib") is None, reason="matplotlib is not installed")
needs_vtk = pytest.mark.skipif(find_spec("vtkmodules") is None, reason="VTK is not installed")


class Drawn:
    """A session whose frames end at once, in an image or an error, before they can be aborted."""

    def __init__(self, error: Exception | None = None) -> None:
        self._error = error

    def render(self, scene: Scene) -> torch.Tensor:
        if self._error is not None:
            raise self._error
        return torch.ones(1, 1, 4)

    def abort(self) -> None:
        """Too late."""


@pytest.mark.parametrize(
    ("session", "told"),
    [
        (Drawn(PeerLost("the last map/shade server is gone")), "the last map/shade server is gone"),
        (Drawn(), r"100 frames in a row .* draw more: a larger --image or --phantom"),
    ],
)
def test_aborts_that_cannot_be_timed_end_with_what_keeps_them_from_it(session: Drawn, told: str) -> None:
    with pytest.raises(VolsplatError, match=told):
        abort_times(cast("Session", session), preset_scene("ct-skin"), 3, 0.0, Random(1), lambda: None)


def test_servers_that_stand_for_machines_have_as_many_threads_in_every_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Or several over one would be the same cores, cut in another way."""
    write_volume(tmp_path / "shells.nrrd", *make_phantom("shells", size=(24, 24, 24)))
    monkeypatch.setattr(renderers, "usable_cores", lambda: 7)
    with opened_rows(str(tmp_path / "shells.nrrd"), [1, 3], lambda text: None, None, like_machines=True) as rows:
        for row in rows[1:]:
            scene = row.renderer.volume.default_scene().with_(size=32)
            assert row.renderer.finish(scene).complete and isinstance(row.renderer, Session)
            threads = sorted((one.role.value, one.threads) for one in row.renderer.servers)
            expected = [(Role.MAPSHADE_SERVER.value, 2)] * row.workers + [(Role.SPLAT_SERVER.value, 7)]
            assert threads == sorted(expected)


def test_a_server_that_cannot_start_ends_its_row_with_the_cause(tmp_path: Path) -> None:
    write_volume(tmp_path / "shells.nrrd", *make_phantom("shells", size=(24, 24, 24)))
    with pytest.raises(PeerLost, match=r"the map/shade server \(process \d+\) ended with status 2"):
        with session_of_machines(str(tmp_path / "shells.nrrd"), 1, threads=0, say=lambda text: None, memory=None):
            pass


@needs_matplotlib
def test_the_paper_s_table_stands_beside_this_machine_s(person: Person) -> None:
    options = ("--size", "64x48", "--workers", "1,2", "--repeats", "2")
    found, markdown, printed = measured(person, "paper", *PHANTOM, *options, plot=True)
    rows = ("1 thread", "1 server", "2 servers")
    assert {one.name for one in found.figures} == {f"{row}, step {step}" for row in rows for step in PAPER_STEPS}
    assert all(len(one.samples) == 2 and one.low > 0 for one in found.figures)
    for machine, seconds in PAPER_SECONDS.items():
        assert f"| 1989, {machine} | {' | '.join(map(str, seconds))} |" in markdown
    assert "24 x 24 x 24 voxels" in printed and "visible" in printed
    assert "Each map/shade server has " in markdown and "in every row, as if it were a machine" in markdown
    assert "1989, 4 Sun-3 over 1 Sun-3 | 6.67 | 2.86 | 2.57 | 4.26 | 4.11 | 4.03" in markdown


@needs_matplotlib
def test_scaling_grows_one_thing_at_a_time_and_names_what_limits(person: Person) -> None:
    options = ("--workers", "1,2", "--sizes", "0.5,1", "--images", "32,48", "--repeats", "2")
    found, markdown, printed = measured(person, "scaling", *PHANTOM, *options, "--predict", "3,64", plot=True)
    frames = [one.name for one in found.figures if one.name.endswith(": frame")]
    assert len(frames) == len(set(frames)) == 3 * (2 + 2 + 4)
    assert "what limits 2 servers: " in printed
    assert "efficiency" in markdown and "MB into the splat server" in markdown and "| M packets |" in markdown
    assert f"machines of 2 servers: {this_machine().host} (" in printed
    assert "link of 2 servers: " in printed and "MB of image out of it" in printed
    predicted = [
        row.split(" | ")[1:3] for row in markdown.split("Predicted by the model")[1].splitlines() if "bit/s" in row
    ]
    assert predicted == 2 * [["3", "1 Gbit/s"], ["3", "10 Gbit/s"], ["64", "1 Gbit/s"], ["64", "10 Gbit/s"]]


@pytest.mark.skipif(not THREADS_OF_PROCESS.is_dir(), reason="only Linux shows what each thread takes")
def test_scaling_counts_what_each_thread_takes(person: Person) -> None:
    options = ("--workers", "1", "--threads", "1,3", "--sizes", "1", "--images", "32", "--repeats", "2")
    found, markdown, _ = measured(person, "scaling", *PHANTOM, *options)
    figures = {one.name: one for one in found.figures}
    assert 0 <= figures["3 threads: serial part"].median < 1 and figures["1 thread: processor time"].low > 0
    assert "| serial part, % |" in markdown


def test_scaling_measures_a_cluster_that_is_already_up(person: Person) -> None:
    volume = person.folder / "shells.nrrd"
    write_volume(volume, *make_phantom("shells", size=(24, 24, 24)))
    address = f"127.0.0.1:{free_port()}"
    servers = [person.starts("splat-server", "--connect", address)]
    servers += [person.starts("mapshade-server", "--connect", address) for _ in range(2)]
    options = ("--listen", address, "--workers", "2", "--sizes", "1", "--images", "32", "--repeats", "1")
    found, _, _ = measured(person, "scaling", str(volume), *options)
    assert {one.name.split(", ")[1].split(":")[0] for one in found.figures} == {"1 thread", "2 servers"}
    for server in servers:
        server.communicate(timeout=PATIENCE)


@needs_matplotlib
def test_kernels_are_measured_on_every_path_beside_their_floors(person: Person) -> None:
    from volsplat.bench import _kernels

    options = ("--size", "16", "--splats", "1000", "--rounds", "2")
    found, markdown, _ = measured(person, "kernels", *options, plot=True)
    names = {one.name for one in found.figures}
    for path in _kernels.cpu_paths():
        for rows in ("level", "lean"):
            assert {f"splat {side}x{side}, {rows}, {path}, bare loop" for side in (4, 8, 12, 16)} <= names
            assert {f"splat 8x8, {rows}, {path}, {order} over bare" for order in ("btf", "ftb")} <= names
        assert f"map/shade noise, {path}, every voxel along k" in names
    assert "memory copy" in names and "| 8x8 |" in markdown


@needs_vtk
def test_peers_draw_the_same_pictures_and_leave_them_side_by_side(person: Person) -> None:
    options = ("--images", "64", "--views", "2", "--threads", "1,2", "--distances", "1,0.5", "--pictures", "pictures")
    found, markdown, printed = measured(person, "peers", *PHANTOM, *options)
    by_name = {one.name: one for one in found.figures}
    assert len([name for name in by_name if name.endswith("threads")]) == 1 + 2 + 2 * 2
    assert by_name["64x64, SSIM of volsplat and VTK at 0.5 voxel"].median > 0
    assert 0.05 < by_name["64x64, share of voxels visible"].median < 0.3
    assert "hidden" in printed and "volsplat, servers" in markdown
    pictures = sorted((person.folder / "pictures").iterdir())
    assert [path.name for path in pictures] == ["64-view-00.png", "64-view-01.png"]
    assert read_image(pictures[0]).shape[:2] == (64, 3 * 64)


def test_aborts_are_timed(person: Person) -> None:
    found, _, _ = measured(person, "aborts", *PHANTOM, "--aborts", "2", "--image", "200", "--workers", "1")
    assert len(found.figures) == 4


def test_links_are_measured_by_each_way(person: Person) -> None:
    found, markdown, _ = measured(person, "links", "--rounds", "2")
    assert len(found.figures) == 3 * 5 and "TLS 1.3" in markdown
    assert all(one.median > 0 for one in found.figures if one.unit == "s" and "processor" not in one.name)


def test_images_are_weighed(person: Person) -> None:
    found, _, _ = measured(person, "images", *PHANTOM, "--images", "3", "--image", "100")
    size = {one.name: one.median for one in found.figures if one.unit == "B"}
    assert 0 < size["8 bits: bytes"] < size["exact: bytes"] < 100 * 100 * 16


def test_the_page_s_pictures_are_timed_and_told_by_step_and_size(person: Person) -> None:
    chromium_executable()
    found, markdown, _ = measured(person, "page", "--phantom", "shells:24", "--moves", "30")
    ways = re.findall(r"([A-G]) in (\d+) x (\d+)(?: with 1 of \d+ voxels)? (\d+)%", found.facts["drawn as"])
    assert all(step == "F" and width == height and int(width) <= 512 for step, width, height, _ in ways)
    assert sum(int(share) for *_, share in ways) == pytest.approx(100, abs=len(ways))
    assert found.facts["stale images"] == "0" and "512 x 512 pixels, 30 moves" in markdown
    median = {one.name: one.median for one in found.figures}
    assert 0 < median["event to canvas"] <= median["event to canvas: 95 %"]
    assert 0 < median["start: first picture"] <= median["start: first that can be turned"]
    assert 0.5 < median["likeness"] <= 1.0 and median["images a second"] > 0


def test_sizes_of_a_cluster_come_into_one_file(person: Person) -> None:
    options = ("--sizes", "1", "--images", "32", "--repeats", "2")
    for count in ("1", "2", "3"):
        measured(person, "scaling", *PHANTOM, *options, "--workers", count)
        (person.folder / "found.json").rename(person.folder / f"{count}.json")
    done = person.runs("bench", "compare", "1.json", "2.json", "3.json", "--json", "all.json")
    assert done.returncode == 0
    assert re.search(r"setting +1 server +2 servers +3 servers", done.stdout)
    joined = read_record(person.folder / "all.json")
    assert {one.servers for one in joined.figures} == {0, 1, 2, 3}
    names = [one.name for one in joined.figures]
    assert len(names) == len(set(names))
    one_thread = next(one for one in joined.figures if one.servers == 0 and one.name.endswith(": frame"))
    assert len(one_thread.samples) == 3 * 2
    assert "link of 3 servers" in joined.facts


@needs_matplotlib
def test_two_records_are_compared(person: Person) -> None:
    measured(person, "kernels", "--size", "16", "--splats", "1000", "--rounds", "1")
    done = person.runs("bench", "compare", "found.json", "found.json")
    assert done.returncode == 0 and "1.00" in done.stdout and "moved" not in done.stdout
    done = person.runs("bench", "compare", "found.json", "found.md")
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "no record" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "cause"),
    [
        (("paper",), "give a VOLUME"),
        (("paper", "missing.nrrd"), "no such file"),
        (("paper", "--phantom", "shells"), "NAME:SIZE"),
        (("paper", "--phantom", "cube:8"), "NAME:SIZE"),
        (("paper", *PHANTOM, "--workers", "0"), "--workers 0"),
        (("paper", *PHANTOM, "--size", "big"), "--size big"),
        (("paper", *PHANTOM, "--plot", "a.jpg"), "PNG"),
        (("paper", *PHANTOM, "--json", "no/where.json"), "cannot write"),
        (("paper", *PHANTOM, "--tables", "skin", "--preset", "ct-bone"), "--tables skin"),
        (("scaling", *PHANTOM, "--sizes", "2"), "--sizes 2"),
        (("scaling", *PHANTOM, "--spawn", "none"), "--listen"),
        (("scaling", *PHANTOM, "--threads", "none"), "--threads none"),
        (("scaling", "a.nrrd", "--listen", "127.0.0.1:0", "--workers", "1", "--threads", "2"), "with a cluster"),
        (("scaling", "a.nrrd", "--listen", "127.0.0.1:0", "--workers", "1,2"), "one number"),
        (("peers", *PHANTOM, "--distances", "0"), "--distances 0"),
        (("peers", *PHANTOM, "--images", "-4"), "--images -4"),
        (("peers", *PHANTOM, "--preset", "depth-cue", "--threads", "1"), "VTK cannot look"),
        (("aborts", "--phantom", "shells:0"), "NAME:SIZE"),
        (("compare", "a.json", "b.json"), "cannot read"),
        (("compare", "a.json"), "two records or more"),
        (("nothing",), "there is no benchmark"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else None,
)
def test_a_mistake_is_one_line_and_exit_status_2(person: Person, arguments: tuple[str, ...], cause: str) -> None:
    done = person.runs("bench", *arguments)
    assert done.returncode == 2
    assert cause in done.stderr and done.stderr.strip().count("\n") == 0


@pytest.mark.parametrize(
    ("missing", "arguments"),
    [("vtkmodules", ["peers", *PHANTOM]), ("matplotlib", ["kernels", "--plot", "a.png"])],
)
def test_a_missing_extra_is_one_line_with_the_cure(
    monkeypatch: pytest.MonkeyPatch, missing: str, arguments: list[str]
) -> None:
    monkeypatch.setattr(extras, "find_spec", lambda name: None if name == missing else find_spec(name))
    with pytest.raises(BadInput, match=r"pip install --extra-index-url .* 'volsplat\[bench\]'") as raised:
        bench.main(arguments, standalone_mode=False)
    assert "\n" not in str(raised.value)


def test_every_benchmark_that_is_listed_is_there() -> None:
    context = click.Context(bench)
    assert bench.list_commands(context) == list(SUMMARIES)
    for name in SUMMARIES:
        command = bench.get_command(context, name)
        assert command is not None and command.name == name and command.help


@pytest.mark.parametrize("command", ["paper", "scaling"])
def test_ctrl_c_leaves_no_process(person: Person, command: str) -> None:
    run = person.starts("bench", command, *PHANTOM, "--workers", "2", "--repeats", "100000")
    wait_until(lambda: len(person.servers()) == 3, "started")
    run.send_signal(signal.SIGINT)
    _, said = run.communicate(timeout=PATIENCE)
    assert run.returncode == INTERRUPTED and "Traceback" not in said, said
    wait_until(lambda: not person.servers(), "without servers")


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> StepReport:
    """Of a frame."""
    path = tmp_path_factory.mktemp("volumes") / "shells.nrrd"
    write_volume(path, *make_phantom("shells", size=(16, 16, 16)))
    with SingleProcess(path) as single:
        scene = single.volume.default_scene()
        outcome = single.finish(scene).outcome
        assert outcome is not None
        return report_of(single.volume, scene, [outcome]).steps[0]


NODES = [Machine(f"node-{n}", "Linux", "a processor", 2) for n in range(4)]


@pytest.mark.parametrize(
    ("seconds", "named"),
    [
        (
            {"map_shade_seconds_slowest": 0.8, "map_shade_seconds": 0.9, "splat_waiting_seconds": 0.8},
            "slowest map/shade",
        ),
        ({"splat_seconds": 0.7, "merge_seconds": 0.2, "splat_waiting_seconds": 0.1}, "splat server"),
        ({"splat_waiting_seconds": 0.9, "map_shade_waiting_seconds_slowest": 0.8}, "links"),
        ({"splat_seconds": 0.2, "splat_waiting_seconds": 0.1, "image_seconds": 0.7}, "image"),
        ({"splat_seconds": 0.2, "image_seconds": 0.3, "accounted_share": 0.5}, "client"),
        ({"splat_seconds": 0.2, "image_seconds": 0.2, "messages_seconds": 0.6}, "client"),
    ],
)
def test_the_bottleneck_is_where_most_of_the_frame_went(
    report: StepReport, seconds: dict[str, float], named: str
) -> None:
    assert bottleneck(_frame(report, {}, **seconds)).name == named


def test_the_cores_of_one_machine_are_the_bottleneck_if_its_servers_fill_them(report: StepReport) -> None:
    seconds = {"splat_seconds": 0.9, "splat_waiting_seconds": 0.1, "map_shade_seconds_slowest": 0.5}
    shared = _frame(report, {2: NODES[0], 3: NODES[0]}, **seconds)
    assert bottleneck(shared).name == "all 2 cores, most by splat server"
    crowded = _frame(report, {2: NODES[0], 3: NODES[0], 4: NODES[1]}, **seconds)
    assert bottleneck(crowded).name == "all 2 cores of node-0, most by splat server"


def test_as_much_work_on_machines_of_their_own_fills_none(report: StepReport) -> None:
    waiting = {"splat_seconds": 0.3, "splat_waiting_seconds": 0.6, "map_shade_seconds_slowest": 0.5}
    frame = _frame(report, {2: NODES[1], 3: NODES[2], 4: NODES[3]}, **waiting)
    assert bottleneck(frame).name == "slowest map/shade"


def _frame(report: StepReport, machines: dict[int, Machine], **seconds: float) -> StepReport:
    """A frame of a second with the splat server on node 0, and map/shade servers that each worked half of it."""
    nothing = {field: 0.0 for field in report.__struct_fields__ if field.endswith(("_seconds", "_slowest"))}
    stats = next(iter(report.workers.values()))
    workers = {n: msgspec.structs.replace(stats, machine=on, map_shade_seconds=0.5) for n, on in machines.items()}
    took = {stage: seconds.get(stage, 0.0) for stage in ("planning_seconds", "merge_seconds", "splat_seconds")}
    splat = msgspec.structs.replace(report.slowest_splat_server, machine=NODES[0], **took)
    whole = {"wall_seconds": 1.0, "accounted_share": 1.0, "workers": workers, "splat_servers": {1: splat}}
    return msgspec.structs.replace(report, **{**nothing, **whole, **seconds})
