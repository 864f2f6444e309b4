"""The command as a person meets it: real processes, real files, one clear line for each mistake."""

import json
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import numpy
import PIL.Image
import psutil
import pytest
import tifffile
import torch

from support.files.images import read_image
from support.files.reflection_files import mtz
from support.patience import PATIENCE, wait_until
from support.programs.hand_started import free_port
from support.programs.programs import VOLSPLAT, Person, is_under_way
from volsplat.client.image.image_file import read_scene
from volsplat.client.phantoms import PHANTOMS, make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.program.exit_status import EXIT_BAD_INPUT

SIZE = ["--size", "96x96"]
INTERRUPTED = 130


@pytest.fixture(scope="module")
def head(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small head."""
    path = tmp_path_factory.mktemp("volumes") / "head.nrrd"
    write_volume(path, *make_phantom("head", size=(32, 40, 36)))
    return path


@pytest.fixture
def person(tmp_path: Path) -> Person:
    return Person(tmp_path)


def draws(person: Person, volume: Path, output: str, *options: str) -> bytes:
    done = person.runs("render", str(volume), "-o", output, *SIZE, *options)
    assert done.returncode == 0, done.stderr
    return (person.folder / output).read_bytes()


@pytest.mark.parametrize(("suffix", "counts"), [(".png", ("1", "2", "4")), (".exr", ("2",))])
def test_files_are_the_same_for_any_number_of_workers_and_for_a_single_process(
    person: Person, head: Path, suffix: str, counts: tuple[str, ...]
) -> None:
    single = draws(person, head, f"single{suffix}", "--single", "--edges")
    for workers in counts:
        assert draws(person, head, f"{workers}{suffix}", "--workers", workers, "--edges") == single
    assert person.servers() == []


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif", ".exr"])
def test_an_image_can_be_drawn_again_from_itself(person: Person, head: Path, suffix: str) -> None:
    changes = ["--rotate", "40,20", "--bounds", "4:,:30,:", "--order", "ftb", "--preset", "ct-bone", "--zoom", "2.5"]
    first = draws(person, head, f"first{suffix}", "--single", *changes)
    done = person.runs("render", str(head), "-o", f"again{suffix}", "--scene", f"first{suffix}", "--single")
    assert done.returncode == 0, done.stderr
    assert (person.folder / f"again{suffix}").read_bytes() == first
    assert read_scene(person.folder / f"first{suffix}").image.width == 96


def test_all_six_steps_and_a_report_are_written(person: Person, head: Path) -> None:
    final = draws(person, head, "out.png", "--workers", "2", "--steps-dir", "steps", "--report", "report.json")
    images = sorted((person.folder / "steps").iterdir())
    assert [image.name for image in images] == [f"step-{step}.png" for step in "ABCDEF"]
    assert len({image.read_bytes() for image in images}) == 6
    assert images[-1].read_bytes() == final
    steps = json.loads((person.folder / "report.json").read_text(encoding="utf-8"))["steps"]
    assert [step["step"] for step in steps] == list("ABCDEF")
    assert steps[2]["voxels_visited"] == 32 * 40 * 36 == 8 * steps[1]["voxels_visited"]
    assert all(step["packets_sent"] * 8 < step["bytes_uncoded"] for step in steps)
    assert sorted(name.rstrip(" 0123456789") for name in steps[0]["peak_memory_bytes"]) == [
        "client",
        "map/shade server",
        "map/shade server",
        "splat server",
    ]


def test_an_earlier_step_may_be_the_last(person: Person, head: Path) -> None:
    assert draws(person, head, "b.png", "--single", "--step", "B") != draws(person, head, "f.png", "--single")


def test_exr_keeps_alpha_and_png_lies_on_the_background(person: Person, head: Path) -> None:
    (person.folder / "s.toml").write_text("[image]\nbackground = [1.0, 1.0, 1.0]\n")
    draws(person, head, "a.exr", "--single", "--scene", "s.toml")
    draws(person, head, "a.png", "--single", "--scene", "s.toml")
    associated, shown = read_image(person.folder / "a.exr"), read_image(person.folder / "a.png")
    assert torch.equal(associated[0, 0], torch.zeros(4))
    assert torch.equal(shown[0, 0, :3], torch.ones(3))


def test_a_preset_prints_a_scene_that_draws_the_same(person: Person, head: Path) -> None:
    printed = person.runs("scene", "--preset", "depth-cue")
    (person.folder / "cue.toml").write_text(printed.stdout)
    done = person.runs("render", str(head), "-o", "cue.png", "--single", "--scene", "cue.toml")
    assert done.returncode == 0, done.stderr


def test_info_tells_what_a_volume_is(person: Person, head: Path) -> None:
    done = person.runs("info", str(head))
    assert done.returncode == 0, done.stderr
    assert "32 x 40 x 36" in done.stdout and "uint16" in done.stdout and "█" in done.stdout


def test_info_tells_what_else_can_be_named_of_a_file(person: Person) -> None:
    mtz(person.folder / "refined.mtz", columns="FWT:F PHWT:P")
    done = person.runs("info", "refined.mtz")
    assert done.returncode == 0, done.stderr
    assert "#map:FWT,PHWT" in done.stdout and "#amplitude:FWT" in done.stdout
    parts = json.loads(person.runs("info", "refined.mtz", "--json").stdout)["parts"]
    assert [one["part"] for one in parts][0] == "map:FWT,PHWT"
    assert all(person.runs("info", f"refined.mtz#{one['part']}").returncode == 0 for one in parts[:2])
    assert json.loads(person.runs("info", "refined.mtz#map", "--json").stdout)["parts"] == []


def test_a_phantom_is_told_by_the_help_and_one_that_is_not_there_with_what_was_meant(person: Person) -> None:
    told = person.runs("phantom", "--help").stdout
    assert all(name in told for name in PHANTOMS)
    for number in (["--seed", str(2**64)], ["--spacing", "1e308,1,1"]):
        done = person.runs("phantom", "head", "-o", "x.nrrd", "--size", "8", *number)
        assert (done.returncode, len(one_line(done)) < 200) == (2, True)
    done = person.runs("phantom", "Haed", "-o", "x.nrrd")
    assert done.returncode == 2
    assert "Invalid value for 'NAME': there is no 'Haed' (did you mean head?)" in one_line(done)
    asked = one_line(person.runs("phantom"))
    assert "?" not in asked and all(name in asked for name in PHANTOMS)


def one_line(done: "subprocess.CompletedProcess[str]") -> str:
    lines = done.stderr.splitlines()
    assert len(lines) == 1, done.stderr
    return lines[0]


BAD_OPTIONS = {
    "no output": ([], "nothing to write"),
    "no workers": (["-o", "a.png", "--workers", "0"], "--workers"),
    "bounds outside": (["-o", "a.png", "--bounds", "0:99,:,:"], "bounds on i"),
    "bounds malformed": (["-o", "a.png", "--bounds", "0-9"], "--bounds"),
    "unknown kind of image": (["-o", "a.gif"], ".exr"),
    "folder missing": (["-o", "nowhere/a.png"], "nowhere"),
    "bounds below 0": (["-o", "a.png", "--bounds", "-1:8,:,:"], "whole numbers from 0"),
    "bounds without end": (["-o", "a.png", "--bounds", f"{10**20}:,:,:"], "no volume is longer"),
    "zoom zero": (["-o", "a.png", "--zoom", "0"], "zoom"),
    "zoom in words": (["-o", "a.png", "--zoom", "close"], "pixels a voxel, as in 2.5, or fit"),
    "size": (["-o", "a.png", "--size", "12x"], "--size"),
    "window": (["-o", "a.png", "--window", "5"], "LOW,HIGH"),
    "colour": (["-o", "a.png", "--background", "whit"], "#rrggbb"),
    "colour map": (["-o", "a.png", "--colormap", "virids"], "did you mean viridis"),
    "key": (["-o", "a.png", "--set", "shading.spekular=true"], "shading.spekular"),
    "rotation": (["-o", "a.png", "--rotate", "sideways"], "front"),
    "step": (["-o", "a.png", "--step", "H"], "--step"),
    "preset": (["-o", "a.png", "--preset", "CT-bon"], "did you mean ct-bone"),
    "address": (["-o", "a.png", "--listen", "here"], "HOST:PORT"),
    "spawn none": (["-o", "a.png", "--spawn", "none"], "--listen"),
    "scene without end": (["-o", "a.png", "--scene", "/dev/zero"], "more than 4.0 MiB"),
    "silence of no number": (["-o", "a.png", "--silence", "nan"], "--silence"),
    "scene missing": (["-o", "a.png", "--scene", "none.toml"], "none.toml"),
    "report is a folder": (["-o", "a.png", "--report", "."], "--report"),
    "steps below a file": (["--steps-dir", "/dev/null/steps"], "--steps-dir"),
    "servers of one process": (["-o", "a.png", "--single", "--workers", "2"], "leave out --workers"),
    "threads of others": (["-o", "a.png", "--cluster", "lab.toml", "--threads", "2"], "leave out --threads"),
    "threads of nobody": (["-o", "a.png", "--listen", "127.0.0.1:0", "--threads", "2"], "leave out --threads"),
    "token file missing": (["-o", "a.png", "--token-file", "none"], "token"),
}


@pytest.mark.parametrize("case", BAD_OPTIONS)
def test_a_bad_option_is_one_clear_line_and_status_2(person: Person, head: Path, case: str) -> None:
    options, named = BAD_OPTIONS[case]
    done = person.runs("render", str(head), *options)
    assert (done.returncode, named in one_line(done)) == (2, True), done.stderr
    assert list(person.folder.iterdir()) == []
    assert person.servers() == []


def test_a_file_whose_name_begins_like_an_options_is_told_how_to_be_named(person: Person, head: Path) -> None:
    shutil.copy(head, person.folder / "-head.nrrd")
    done = person.runs("info", "-head.nrrd")
    assert done.returncode == EXIT_BAD_INPUT and "the file of that name is given as ./-head.nrrd; see" in one_line(done)
    assert person.runs("info", "./-head.nrrd").returncode == 0


def test_a_phantom_takes_the_place_of_no_other_volumes_voxels(person: Person) -> None:
    assert person.runs("phantom", "ramp", "--size", "8", "-o", "v.nhdr").returncode == 0
    before = (person.folder / "v.raw").read_bytes()
    done = person.runs("phantom", "shells", "--size", "8", "-o", "v.mhd")
    assert done.returncode == EXIT_BAD_INPUT and "v.raw, which is there already" in one_line(done)
    assert (person.folder / "v.raw").read_bytes() == before
    assert person.runs("phantom", "shells", "--size", "8", "-o", "v.nhdr").returncode == 0


def test_an_unknown_command_names_the_one_that_was_meant(person: Person, head: Path) -> None:
    for word, cure in (
        ("rendr", "did you mean render?"),
        (str(head), f"to look at it: volsplat view {head}"),
        ("help", "it is an option, --help"),
    ):
        done = person.runs(word, "head.nrrd")
        assert (done.returncode, cure in one_line(done)) == (2, True)


def test_an_unknown_benchmark_names_the_one_that_was_meant(person: Person) -> None:
    done = person.runs("bench", "papers")
    assert (done.returncode, "did you mean paper?" in one_line(done)) == (2, True)


NAMES_ITS_THREADS = """
import os
from volsplat.client.command.cli import main
try:
    main()
finally:
    print(os.environ["OPENBLAS_NUM_THREADS"])
"""


@pytest.mark.parametrize(("given", "kept"), [({}, "1"), ({"OPENBLAS_NUM_THREADS": "3"}, "3")])
def test_numpy_gets_no_threads_unless_a_person_says_so(given: dict[str, str], kept: str) -> None:
    inherited = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    command = [sys.executable, "-c", NAMES_ITS_THREADS, "--version"]
    done = subprocess.run(command, env=inherited | given, capture_output=True, text=True, timeout=PATIENCE)
    assert done.stdout.splitlines()[-1:] == [kept], done.stderr


def test_python_runs_the_command_where_its_script_is_in_no_folder_of_path(tmp_path: Path) -> None:
    def run(*words: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "volsplat", *words]
        return subprocess.run(command, cwd=tmp_path, env={"PATH": ""}, capture_output=True, text=True, timeout=PATIENCE)

    assert run("--version").stdout.startswith("volsplat, version")
    mistaken = run("rendr")
    assert mistaken.returncode == 2 and mistaken.stderr.count("\n") == 1
    assert mistaken.stderr.endswith("(did you mean render?); see python -m volsplat --help\n")


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("[view]\nzooom = 1", "view.zooom"),
        ("[view]\nzoom = -1", "view"),
        ("[tables.opac]\npoints = [[0.0, 2.0]]", "tables.opac"),
        ("order = 'sideways'", "order"),
        ("[view\nzoom = 1", "bad.toml:1:6"),
    ],
)
def test_a_bad_scene_is_named_with_its_place(person: Person, head: Path, text: str, named: str) -> None:
    (person.folder / "bad.toml").write_text(text)
    done = person.runs("render", str(head), "-o", "a.png", "--scene", "bad.toml")
    assert done.returncode == 2
    assert "bad.toml" in one_line(done) and named in one_line(done)
    assert not (person.folder / "a.png").exists()


@pytest.mark.parametrize("case", ["missing", "truncated", "promises more", "empty", "text"])
@pytest.mark.parametrize("options", [[], ["--single"]], ids=["servers", "single"])
def test_a_bad_volume_is_one_clear_line_and_the_old_image_stays(
    person: Person, head: Path, case: str, options: list[str]
) -> None:
    volume, image = person.folder / "bad.nrrd", person.folder / "old.png"
    image.write_bytes(b"an older image")
    data = head.read_bytes()
    if case == "truncated":
        volume.write_bytes(data[: len(data) // 2])
    elif case == "promises more":
        volume.write_bytes(data.replace(b"sizes: 32 40 36", b"sizes: 32 40 99"))
    elif case != "missing":
        volume.write_bytes(b"" if case == "empty" else b"not a volume\n")
    done = person.runs("render", str(volume), "-o", "old.png", *options)
    assert done.returncode == 2 and "bad.nrrd" in one_line(done), done.stderr
    assert image.read_bytes() == b"an older image"
    assert person.servers() == []


@pytest.mark.parametrize("option", ["-o", "--report"])
def test_a_volume_is_never_overwritten(person: Person, option: str) -> None:
    volume = person.folder / "stack.tif"
    write_volume(volume, *make_phantom("head", size=(12, 12, 12)))
    before = volume.read_bytes()
    done = person.runs("render", "stack.tif", "--steps-dir", "steps", option, str(volume))
    assert done.returncode == 2 and "stack.tif" in one_line(done)
    assert volume.read_bytes() == before


def test_bounds_outside_the_volume_leave_no_folder(person: Person, head: Path) -> None:
    done = person.runs("render", str(head), "--steps-dir", "new/steps", "--bounds", ":,:,90:")
    assert done.returncode == 2 and "bounds on k" in one_line(done)
    assert list(person.folder.iterdir()) == []


def test_a_port_in_use_is_named(person: Person, head: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = person.runs("render", str(head), "-o", "a.png", "--listen", f"127.0.0.1:{port}")
    assert done.returncode == 2 and str(port) in one_line(done)


@pytest.mark.parametrize("order", ["servers first", "client first", "splat server last"])
def test_servers_started_by_hand_join_in_any_order(person: Person, head: Path, order: str) -> None:
    address = f"127.0.0.1:{free_port()}"
    commands = {
        "client": ["render", str(head), "-o", "hand.png", *SIZE, "--listen", address, "--workers", "2"],
        "splat": ["splat-server", "--connect", address],
        "first": ["mapshade-server", "--connect", address],
        "second": ["mapshade-server", "--connect", address],
    }
    names = {
        "servers first": ["splat", "first", "second", "client"],
        "client first": ["client", "splat", "first", "second"],
        "splat server last": ["first", "client", "second", "splat"],
    }[order]
    running = {name: person.starts(*commands[name]) for name in names}
    for name, process in running.items():
        _, said = process.communicate(timeout=PATIENCE)
        assert process.returncode == 0, (name, said)
    assert (person.folder / "hand.png").read_bytes() == draws(person, head, "single.png", "--single")


def test_the_commands_that_a_client_prints_join_by_its_token_file(person: Person, head: Path) -> None:
    options = ["--listen", "127.0.0.1:0", "--workers", "1", "--token-file", "its secret"]
    client = person.starts("render", str(head), "-o", "hand.png", *SIZE, *options)
    assert client.stderr is not None
    said = (line for line in client.stderr if line.startswith("volsplat "))
    printed = [shlex.split(next(said)) for _ in ("splat server", "map/shade server")]
    stranger = Person(person.folder)  # whose environment has another token
    servers = [stranger.starts(*words) for _, *words in printed]
    for process in (client, *servers):
        _, told = process.communicate(timeout=PATIENCE)
        assert process.returncode == 0, told


def listens(address: str) -> bool:
    port = int(address.rpartition(":")[2])
    listening = (one.laddr for one in psutil.net_connections("tcp") if one.status == psutil.CONN_LISTEN)
    return any(place and place.port == port for place in listening)


def test_a_server_with_another_token_gets_one_line_and_disturbs_nobody(person: Person, head: Path) -> None:
    address = f"127.0.0.1:{free_port()}"
    client = person.starts("render", str(head), "-o", "a.png", *SIZE, "--listen", address, "--workers", "1")
    wait_until(lambda: listens(address), "does the client listen")
    stranger = Person(person.folder).runs("mapshade-server", "--connect", address)
    assert stranger.returncode == 2 and "token" in one_line(stranger)
    servers = [person.starts(kind, "--connect", address) for kind in ("splat-server", "mapshade-server")]
    assert client.wait(PATIENCE) == 0
    assert [server.wait(PATIENCE) for server in servers] == [0, 0]
    for process in (client, *servers):
        process.communicate()


def test_a_server_without_a_client_ends_with_one_line(person: Person) -> None:
    done = person.runs("splat-server", "--connect", f"127.0.0.1:{free_port()}", "--patience", "0.2")
    assert done.returncode == 1 and "nobody listens" in one_line(done)


def test_a_resident_server_waits_for_clients_in_words_that_tell_of_no_trouble(person: Person) -> None:
    address = f"127.0.0.1:{free_port()}"
    done = person.runs("splat-server", "--connect", address, "--resident", "--keep", "2")
    assert done.stderr.splitlines()[0].endswith(f"no client at {address} yet; waiting for one, up to 2 s")


@pytest.mark.parametrize("after", [0.0, 0.3, 0.6, 1.0, 1.4, 1.8, 2.4])
def test_ctrl_c_at_any_moment_leaves_no_process_and_no_half_image(person: Person, after: float) -> None:
    volume = person.folder / "shells.nrrd"
    write_volume(volume, *make_phantom("shells", size=(128, 128, 128)))
    steps = ["--size", "1500x1500", "--steps-dir", "steps"]
    client = person.starts("render", str(volume), "-o", "a.png", "--workers", "2", *steps)
    interrupted = False
    wait_until(lambda: is_under_way(client), "under way")
    try:
        client.wait(after)
    except subprocess.TimeoutExpired:
        interrupted = True
        client.send_signal(signal.SIGINT)
    _, said = client.communicate(timeout=PATIENCE)
    assert client.returncode in ((INTERRUPTED, -signal.SIGINT) if interrupted else (0,)), said
    assert "Traceback" not in said
    written = [path for path in person.folder.rglob("*") if path.is_file() and path != volume]
    for image in written:  # each is whole, and no temporary file is left
        assert not image.name.startswith(".") and read_image(image).shape[:2] == (1500, 1500)
    wait_until(lambda: not person.servers(), "without servers")


def test_a_client_that_is_killed_takes_its_servers_along(person: Person, head: Path) -> None:
    client = person.starts("render", str(head), "-o", "a.png", "--steps-dir", "steps", "--size", "3000x3000")
    wait_until(lambda: person.servers() or client.poll() is not None, "started")
    client.kill()
    client.communicate()
    wait_until(lambda: not person.servers(), "without servers")
    assert person.servers() == []


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no device that is always full")
@pytest.mark.parametrize(
    "command", [["scene", "--preset", "ct-bone"], ["info", "head.nrrd"], ["--help"], ["splat-server", "--help"]]
)
def test_a_full_disk_behind_the_output_is_told_in_one_line(person: Person, head: Path, command: list[str]) -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [VOLSPLAT, *command],
            cwd=head.parent,
            stdout=full,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            timeout=PATIENCE,
        )
    assert done.returncode == 1
    program = "splat-server" if "splat-server" in command else "volsplat"
    assert done.stderr == f"{program}: the output cannot be written: No space left on device; write it elsewhere\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no device that is always full")
@pytest.mark.parametrize("lost", ["a full disk", "a pipe that nobody reads"])
@pytest.mark.parametrize(
    ("command", "files"),
    [
        (["render", "head.nrrd", "-o", "a.png", "--report", "a.json", "--preset", "labels"], ["a.png", "a.json"]),
        (["movie", "head.nrrd", "-o", "frames", "--frames", "2"], ["frames/frame-00001.png", "frames/frame-00002.png"]),
        (["export", "head.nrrd", "-o", "a.ply"], ["a.ply"]),
    ],
)
def test_a_lost_stderr_takes_no_file_with_it(person: Person, lost: str, command: list[str], files: list[str]) -> None:
    write_volume(person.folder / "head.nrrd", *make_phantom("head", size=(24, 28, 26)))
    reader, writer = os.pipe()
    os.close(reader)
    size = [] if command[0] == "export" else ["--single", "--size", "32"]
    with open("/dev/full", "w") as full, os.fdopen(writer, "w") as unread:
        stderr = full if lost == "a full disk" else unread
        done = subprocess.run([VOLSPLAT, *command, *size], cwd=person.folder, stderr=stderr, timeout=PATIENCE)
    assert done.returncode == 0 and [name for name in files if not (person.folder / name).exists()] == []


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no device that is always full")
def test_a_lost_stderr_ends_no_command_that_begins_with_a_status(person: Person, head: Path) -> None:
    with open("/dev/full", "w") as full:
        command = [str(VOLSPLAT), "scene", str(head)]
        done = subprocess.run(command, cwd=person.folder, stdout=subprocess.PIPE, stderr=full, timeout=PATIENCE)
    assert done.returncode == 0 and b"[tables" in done.stdout


@pytest.mark.parametrize(
    "command",
    [
        ["info", "N"],
        ["scene", "N"],
        ["render", "N", "-o", "a.png"],
        ["render", "head.nrrd", "-o", "N/a.png"],
        ["render", "head.nrrd", "-o", "a.png", "--steps-dir", "N"],
        ["movie", "head.nrrd", "-o", "N"],
        ["export", "head.nrrd", "-o", "N.ply"],
        ["phantom", "ramp", "-o", "N/a.nrrd"],
        ["bench", "paper", "N"],
    ],
)
def test_a_place_that_the_system_refuses_is_one_line(head: Path, command: list[str]) -> None:
    """Here by a name that is too long; folders that others own, which root may enter, come the same way."""
    done = Person(head.parent).runs(*(word.replace("N", "n" * 300) for word in command))
    assert done.returncode == EXIT_BAD_INPUT
    assert done.stderr.count("\n") == 1 and "(File name too long); check its name" in done.stderr


def test_a_volume_without_values_is_described_but_not_drawn(person: Person) -> None:
    numpy.save(person.folder / "none.npy", numpy.full((4, 5, 6), numpy.nan, numpy.float32))
    assert "no voxel has a value" in person.runs("info", "none.npy").stdout
    for command in (["scene", "none.npy"], ["movie", "none.npy", "-o", "film"], ["render", "none.npy", "-o", "a.png"]):
        done = person.runs(*command)
        assert done.returncode == EXIT_BAD_INPUT
        assert done.stderr == (
            "volsplat: none.npy: no voxel has a value, all are NaN or infinite; export the volume again\n"
        )


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_a_terminal_that_is_not_utf8_shows_a_volume(person: Person, head: Path, encoding: str) -> None:
    (person.folder / "zażółć.nrrd").symlink_to(head)
    done = subprocess.run(
        [VOLSPLAT, "info", "zażółć.nrrd"],
        cwd=person.folder,
        env={**person.environment, "PYTHONIOENCODING": encoding},
        capture_output=True,
        timeout=PATIENCE,
    )
    assert done.returncode == 0, done.stderr
    assert b"za\\u017c" in done.stdout and b"####" in done.stdout and b"----" in done.stdout


def test_info_follows_links_out_of_the_folder_and_names_folders_above(person: Person, head: Path) -> None:
    kept, below = person.folder / "kept", person.folder / "slices" / "below"
    kept.mkdir()
    shutil.copy(head, kept / "0a1b")  # as stores of data sets keep files
    numpy.zeros((8, 8, 8), numpy.uint8).tofile(kept / "2c3d")
    below.mkdir(parents=True)
    for number in range(3):
        PIL.Image.fromarray(numpy.full((8, 8), number, numpy.uint8)).save(below.parent / f"{number}.png")
    (below / "head.nrrd").symlink_to(kept / "0a1b")
    (below / "v_8x8x8_uint8.raw").symlink_to(kept / "2c3d")
    for name in ("head.nrrd", "v_8x8x8_uint8.raw", ".."):
        done = Person(below).runs("info", name)
        assert done.returncode == 0 and "dimensions" in done.stdout, done.stderr


@pytest.mark.parametrize(
    ("volume", "written"),
    [
        ("head.nhdr", ["-o", "a.png", "--report", "head.raw"]),
        ("head.nhdr", ["-o", "a.png", "--trace", "head.raw"]),
        ("head.nhdr", ["-o", "a.png", "--single", "--trace", "head.raw"]),
        ("pages", ["-o", "pages/page-3.png"]),
        ("pages", ["-o", "pages/beside.png"]),
        ("pages#page-,spacing=1x1x2", ["-o", "pages/page-9.png"]),
        ("pages", ["-o", "a.png", "--steps-dir", "pages"]),
        ("pages", ["-o", "a.png", "--trace", "pages/page-3.png"]),
        ("tiffs", ["-o", "tiffs/page-3.tif"]),
        ("two.ome.tif", ["-o", "page.tif"]),
        ("v.zarr", ["-o", "a.png", "--report", "v.zarr/zarr.json"]),
        ("v.zarr", ["-o", "v.zarr/inner/a.png"]),
    ],
)
def test_nothing_is_written_over_a_file_that_belongs_to_the_volume(
    person: Person, volume: str, written: list[str]
) -> None:
    before = several_files(person.folder)
    done = person.runs("render", volume, *written)
    assert done.returncode == EXIT_BAD_INPUT and written[-1] in one_line(done)
    assert contents(person.folder) == before


def test_images_lie_in_the_volumes_folder_where_they_are_no_slices(person: Person) -> None:
    several_files(person.folder)
    for report in ("new.json", "new.json"):
        done = person.runs("render", "pages#page-", *SIZE, "-o", "pages/beside.png", "--report", report)
        assert done.returncode == 0, done.stderr
    assert person.runs("render", "pages#page-", *SIZE, "-o", "pages/beside.png").returncode == 0


def test_a_movies_images_are_no_slices(person: Person) -> None:
    before = several_files(person.folder)
    done = person.runs("movie", "pages", "-o", "pages", "--frames", "2")
    assert done.returncode == EXIT_BAD_INPUT and "would change the volume" in one_line(done)
    assert contents(person.folder) == before


def test_a_movies_images_do_not_outnumber_the_slices(person: Person) -> None:
    study = person.folder / "study"
    study.mkdir()
    for number in range(5):
        (study / f"slice-{number}.dcm").touch()
    for frames, told in (("4", "without DICOM images"), ("5", "would change the volume")):
        done = person.runs("movie", "study", "-o", "study", "--frames", frames)
        assert done.returncode == EXIT_BAD_INPUT and told in one_line(done)


@pytest.mark.parametrize(
    "options", [["--report", "/dev/stdout"], ["--trace", "/dev/fd/1"], ["--report", "/proc/self/fd/1"]]
)
def test_records_go_on_after_what_the_output_holds(person: Person, head: Path, options: list[str]) -> None:
    command = [str(VOLSPLAT), "render", str(head), "-o", "a.png", "--single", *SIZE, *options]
    with (person.folder / "out.txt").open("w+b") as out:
        for begin in (b"before\n", b"after\n"):
            out.write(begin)
            out.flush()
            subprocess.run(command, cwd=person.folder, stdout=out, check=True, timeout=PATIENCE)
        out.seek(0)
        nothing, one, other = re.split(b"before\n|after\n", out.read())
    assert not nothing and json.loads(one) and json.loads(other)
    piped = subprocess.run(command, cwd=person.folder, stdout=subprocess.PIPE, check=True, timeout=PATIENCE)
    assert json.loads(piped.stdout)


@pytest.mark.parametrize("command", ["render", "prepare", "mapshade-server", "splat-server", "deploy up"])
def test_a_short_option_asks_for_help_as_well(person: Person, command: str) -> None:
    assert person.runs(*command.split(), "-h").stdout == person.runs(*command.split(), "--help").stdout != ""


def test_a_volume_that_is_a_fifo_is_refused_though_the_output_is_there(person: Person) -> None:
    """To look whether the output belongs to it is not to wait for who writes it."""
    os.mkfifo(person.folder / "pipe.nrrd")
    (person.folder / "a.png").write_bytes(b"an image")
    done = person.runs("render", "pipe.nrrd", "-o", "a.png", "--single")
    assert (done.returncode, "pipe.nrrd" in one_line(done)) == (2, True)


@pytest.mark.parametrize("option", ["--patience", "--keep"])
@pytest.mark.parametrize("value", ["nan", "inf", "1e300"])
def test_a_server_is_not_told_to_wait_for_what_is_no_time(person: Person, option: str, value: str) -> None:
    for waits in (["--connect", "127.0.0.1:1"], ["--wait-at", "127.0.0.1:0", "--resident"]):
        done = person.runs("splat-server", *waits, option, value)
        assert (done.returncode, option in one_line(done)) == (2, True)


def test_a_report_into_a_fifo_leaves_it_there(person: Person, head: Path) -> None:
    fifo = person.folder / "fifo"
    os.mkfifo(fifo)
    reader = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)
    with open(reader, "rb") as reading:
        done = person.runs("render", str(head), "-o", "a.png", "--single", *SIZE, "--report", "fifo")
        assert done.returncode == 0 and json.loads(reading.read()), done.stderr
    assert fifo.is_fifo()


def several_files(folder: Path) -> dict[Path, bytes]:
    """Volumes of several files each, and what these hold."""
    write_volume(folder / "head.nhdr", *make_phantom("head", size=(8, 8, 8)))
    for place, kind in (("pages", "png"), ("tiffs", "tif")):
        (folder / place).mkdir()
        for number in range(4):
            pixels = numpy.full((8, 8), 50 * number, numpy.uint8)
            PIL.Image.fromarray(pixels).save(folder / place / f"page-{number}.{kind}")
    shutil.copy(folder / "tiffs" / "page-1.tif", folder / "page.tif")
    (folder / "v.zarr" / "inner").mkdir(parents=True)
    (folder / "v.zarr" / "zarr.json").write_text("{}", encoding="utf-8")
    set_of_files = '<OME><TiffData><UUID FileName="page.tif"/></TiffData></OME>'
    tifffile.imwrite(folder / "two.ome.tif", numpy.zeros((8, 8), numpy.uint8), description=set_of_files, metadata=None)
    return contents(folder)


def contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.parametrize(
    ("command", "told"),
    [
        (["render", "V", "-o", "a.png", "--report", "-"], "--report -: is no name of a file"),
        (["render", "V", "-o", "a.png", "--report", "notes.txt"], "notes.txt: is there already, and is no report"),
        (["render", "V", "-o", "a.png", "--trace", "V"], "V: this is the volume itself"),
        (["render", "V", "-o", "a.png", "--single", "--trace", "link.json"], "link.json: this is the volume itself"),
        (["render", "V", "-o", "a.png", "--report", "V"], "V: this is the volume itself"),
        (["movie", "V", "-o", "film", "--trace", "V"], "V: this is the volume itself"),
        (["view", "V", "--no-browser", "--trace", "V"], "V: this is the volume itself"),
        (["render", "V", "-o", "a.png", "--report", "a.png"], "a.png: two things would be written"),
        (["render", "V", "-o", "s/step-B.png", "--steps-dir", "s"], "s/step-B.png: two things would be written"),
        (["render", "V", "-o", "a.png", "--report", "t", "--trace", "../T"], "t: two things would be written"),
    ],
)
def test_nothing_is_written_over_the_volume_or_over_one_another(
    person: Person, head: Path, command: list[str], told: str
) -> None:
    shutil.copy(head, person.folder / "v.nrrd")
    (person.folder / "link.json").symlink_to("v.nrrd")
    (person.folder / "notes.txt").write_text("of a month", encoding="utf-8")
    again = f"../{person.folder.name}/t"
    done = person.runs(*(word.replace("V", "v.nrrd").replace("../T", again) for word in command))
    assert done.returncode == EXIT_BAD_INPUT and done.stderr.startswith(f"volsplat: {told.replace('V', 'v.nrrd')}")
    assert (person.folder / "v.nrrd").read_bytes() == head.read_bytes()
    assert sorted(path.name for path in person.folder.iterdir()) == ["link.json", "notes.txt", "v.nrrd"]
