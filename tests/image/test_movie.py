"""Movies as files and folders: the frames that were drawn, in order, or nothing at all."""

import json
import os
import shutil
import signal
import stat
import subprocess
import sys
import threading
from collections.abc import Iterator
from itertools import repeat
from pathlib import Path

import msgspec
import psutil
import pytest
import torch
from torch import Tensor

from support.files.images import over_background, read_image
from support.files.prepared import prepare_small
from support.files.small_disks import small_disk
from support.patience import PATIENCE, wait_until
from support.programs.programs import Person, is_under_way
from support.scenes.arbitrary import plain_scene
from tolerances import HALF_A_LEVEL, VIDEO_LEVELS
from volsplat.client.image.image_file import read_scene
from volsplat.client.movie.key_frames import turntable
from volsplat.client.movie.movie import MovieCancelled, write_movie
from volsplat.client.movie.movie_formats import VIDEO_ENCODERS, check_movie_writable
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.scene.scene_file import scene_toml
from volsplat.client.session.session import Session
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.scene import Image, Scene
from volsplat.protocol.text.errors import BadInput, VolsplatError

FRAMES = 6
INTERRUPTED = 130
KINDS = ["folder", *VIDEO_ENCODERS]

__all__ = ["small_disk"]

needs_ffmpeg = pytest.mark.skipif(
    shutil.which("ffmpeg") is None or shutil.which("ffprobe") is None,
    reason="needs ffmpeg, which writes films: apt install ffmpeg",
)
LUMA = torch.tensor([0.299, 0.587, 0.114])  # BT.601

kinds = pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=() if kind == "folder" else needs_ffmpeg) for kind in KINDS]
)
films = pytest.mark.parametrize("kind", VIDEO_ENCODERS)


@pytest.fixture(scope="module")
def head(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("volumes") / "head.nrrd"
    write_volume(path, *make_phantom("head", size=(32, 40, 36)))
    return path


@pytest.fixture(scope="module")
def single(head: Path) -> Iterator[SingleProcess]:
    with SingleProcess(head) as process:
        yield process


def scenes_of(single: SingleProcess, size: tuple[int, int] = (64, 48), frames: int = FRAMES) -> list[Scene]:
    scene = msgspec.structs.replace(
        single.volume.default_scene(), image=Image(width=size[0], height=size[1], background=(0.2, 0.4, 0.7))
    )
    return turntable(scene, single.volume.description.geometry, frames)


def target(folder: Path, kind: str) -> Path:
    return folder / ("turn" if kind == "folder" else f"turn{kind}")


def written(single: SingleProcess, scenes: list[Scene], path: Path) -> list[int]:
    """Write the movie; what was told of its progress."""
    told: list[int] = []
    write_movie(repeat(single), scenes, path, 10, told.append, lambda: False)
    return told


def film_frames(path: Path, width: int, height: int) -> Tensor:
    """(N, H, W, 3) 0..1, as a player shows the film."""
    command = ["ffmpeg", "-v", "error", "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    raw = subprocess.run(command, capture_output=True, check=True, timeout=PATIENCE).stdout
    return torch.frombuffer(bytearray(raw), dtype=torch.uint8).reshape(-1, height, width, 3) / 255


# -- what is written


def test_a_folder_holds_numbered_images_each_with_its_scene(single: SingleProcess, tmp_path: Path) -> None:
    scenes = scenes_of(single)
    assert written(single, scenes, tmp_path / "turn") == list(range(1, FRAMES + 1))
    images = sorted((tmp_path / "turn").iterdir())
    assert [image.name for image in images] == [f"frame-{n:05}.png" for n in range(1, FRAMES + 1)]
    assert os.listdir(tmp_path) == ["turn"]
    for image, scene in zip(images, scenes, strict=True):
        assert read_scene(image) == scene
        shown = over_background(single.render(scene), scene.image.background)
        assert (read_image(image) - shown).abs().max() <= HALF_A_LEVEL["uint8"]


@needs_ffmpeg
@films
@pytest.mark.parametrize("size", [(64, 48), (63, 47), (1, 1)])
def test_a_film_shows_the_frames_in_order_at_an_even_size(
    single: SingleProcess, tmp_path: Path, kind: str, size: tuple[int, int]
) -> None:
    scenes = scenes_of(single, size)
    path = target(tmp_path, kind)
    assert written(single, scenes, path) == list(range(1, FRAMES + 1))
    assert os.listdir(tmp_path) == [path.name]
    width, height = size[0] + size[0] % 2, size[1] + size[1] % 2
    shown = film_frames(path, width, height)
    assert len(shown) == FRAMES
    background = torch.tensor(scenes[0].image.background)
    for n, scene in enumerate(scenes):
        expected = background.repeat(height, width, 1)
        expected[: size[1], : size[0]] = over_background(single.render(scene), scene.image.background)
        if size == (1, 1):  # colours are kept at a quarter of the pixels, so that its own is lost
            assert ((shown[n] - expected) @ LUMA).abs().mean() <= VIDEO_LEVELS
            continue
        others = [(shown[m] - expected).abs().mean() for m in range(FRAMES) if m != n]
        # Edges differ for the same reason; on average they do not.
        assert (shown[n] - expected).abs().mean() <= VIDEO_LEVELS
        assert (shown[n] - expected).abs().mean() < min(others)


@needs_ffmpeg
@films
def test_a_film_says_its_rate_and_its_colours_so_that_no_player_need_guess(
    single: SingleProcess, tmp_path: Path, kind: str
) -> None:
    path = target(tmp_path, kind)
    written(single, scenes_of(single), path)
    command = ["ffprobe", "-v", "error", "-show_streams", "-of", "json", str(path)]
    (stream,) = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)["streams"]
    assert stream["codec_name"] == {".mp4": "h264", ".webm": "vp9"}[kind]
    assert (stream["pix_fmt"], stream["r_frame_rate"]) == ("yuv420p", "10/1")
    assert (stream["color_space"], stream["color_primaries"], stream["color_range"]) == ("bt709", "bt709", "tv")
    assert stream["color_transfer"] == "iec61966-2-1"


@needs_ffmpeg
def test_flat_colours_come_back_as_they_were(single: SingleProcess, tmp_path: Path) -> None:
    """The film's colour matrix is the one that it names: 601 in place of 709 would be off by some 20 levels."""
    for name, colour in {"red": (0.9, 0.1, 0.1), "green": (0.1, 0.8, 0.2), "blue": (0.2, 0.1, 0.9)}.items():
        empty = msgspec.structs.replace(plain_scene(opacity=0.0), image=Image(width=32, height=32, background=colour))
        written(single, [empty] * 2, tmp_path / f"{name}.mp4")
        shown = film_frames(tmp_path / f"{name}.mp4", 32, 32)
        assert (shown - torch.tensor(colour)).abs().max() <= VIDEO_LEVELS


@needs_ffmpeg
def test_a_folder_with_a_colon_is_no_protocol(
    single: SingleProcess, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("12:30").mkdir()
    written(single, scenes_of(single), Path("12:30/turn.mp4"))
    assert len(film_frames(tmp_path / "12:30" / "turn.mp4", 64, 48)) == FRAMES


@needs_ffmpeg
def test_a_new_film_takes_the_place_of_an_old_one(single: SingleProcess, tmp_path: Path) -> None:
    (tmp_path / "turn.mp4").write_bytes(b"an older film")
    (tmp_path / "turn.mp4").chmod(0o600)
    written(single, scenes_of(single), tmp_path / "turn.mp4")
    assert stat.S_IMODE((tmp_path / "turn.mp4").stat().st_mode) == 0o600, "whom the old one was hidden from sees it"
    assert len(film_frames(tmp_path / "turn.mp4", 64, 48)) == FRAMES
    assert os.listdir(tmp_path) == ["turn.mp4"]


def test_a_folder_keeps_what_is_in_it(single: SingleProcess, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    written(single, scenes_of(single), tmp_path)
    assert len(os.listdir(tmp_path)) == FRAMES + 1
    with pytest.raises(BadInput, match="holds the images of a movie already; remove them, or give another folder"):
        written(single, scenes_of(single), tmp_path)


def test_frames_that_others_push_aside_are_drawn_again(single: SingleProcess, head: Path, tmp_path: Path) -> None:
    done = threading.Event()
    with Session(head, workers=2) as session:

        def disturb() -> None:
            for _ in range(30):
                session.abort()
                done.wait(0.01)

        disturber = threading.Thread(target=disturb)
        disturber.start()
        scenes = scenes_of(single)
        write_movie(repeat(session), scenes, tmp_path / "turn", 10, lambda drawn: None, lambda: False)
        done.set()
        disturber.join()
    for image, scene in zip(sorted((tmp_path / "turn").iterdir()), scenes, strict=True):
        shown = over_background(single.render(scene), scene.image.background)
        assert (read_image(image) - shown).abs().max() <= HALF_A_LEVEL["uint8"]


# -- what is left if it ends early


@kinds
@pytest.mark.parametrize("after", [0, 1, FRAMES])
@pytest.mark.parametrize("there", [False, True], ids=["new", "there before"])
def test_a_cancelled_movie_leaves_everything_as_it_was(
    single: SingleProcess, tmp_path: Path, kind: str, after: int, there: bool
) -> None:
    path = target(tmp_path, kind)
    if there and kind == "folder":
        path.mkdir()
    elif there:
        path.write_bytes(b"an older film")
    told: list[int] = []
    with pytest.raises(MovieCancelled):
        write_movie(repeat(single), scenes_of(single), path, 10, told.append, lambda: len(told) == after)
    assert told == list(range(1, after + 1))
    assert os.listdir(tmp_path) == ([path.name] if there else [])
    if there:
        assert os.listdir(path) == [] if kind == "folder" else path.read_bytes() == b"an older film"
    assert films_in_the_making() == []


@kinds
def test_a_scene_that_cannot_be_drawn_leaves_nothing(single: SingleProcess, tmp_path: Path, kind: str) -> None:
    scenes = scenes_of(single)
    bounds = msgspec.structs.replace(scenes[3].bounds, low=(90, 0, 0))
    scenes[3] = msgspec.structs.replace(scenes[3], bounds=bounds)
    with pytest.raises(BadInput, match="bounds on i are 90..32"):
        written(single, scenes, target(tmp_path, kind))
    assert os.listdir(tmp_path) == []
    assert films_in_the_making() == []


def films_in_the_making() -> list[int]:
    """The ffmpegs that this process has started and that still run."""
    return [child.pid for child in psutil.Process().children(recursive=True) if child.name() == "ffmpeg"]


@pytest.fixture
def only_program(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The one folder in which programs are looked for; empty."""
    folder = tmp_path_factory.mktemp("bin")
    monkeypatch.setenv("PATH", str(folder))
    return folder


def test_a_missing_ffmpeg_is_told_with_the_cure(single: SingleProcess, tmp_path: Path, only_program: Path) -> None:
    cure = r"turn.mp4: .*ffmpeg, which is not installed here; install it .*apt install ffmpeg.*, or give a folder"
    with pytest.raises(BadInput, match=cure):
        written(single, scenes_of(single), tmp_path / "turn.mp4")
    assert os.listdir(tmp_path) == []
    written(single, scenes_of(single), tmp_path / "turn")


@pytest.mark.parametrize("when", ["at once", "after a frame", "at the end"])
def test_a_failing_ffmpeg_is_told_in_its_own_words(
    single: SingleProcess, tmp_path: Path, only_program: Path, when: str
) -> None:
    reads = {"at once": "", "after a frame": "sys.stdin.buffer.read(9000)", "at the end": "sys.stdin.buffer.read()"}
    program = only_program / "ffmpeg"
    program.write_text(
        f"#!{sys.executable}\nimport sys\n{reads[when]}\nopen(sys.argv[-1], 'w').write('half')\n"
        "sys.exit('first words\\nUnknown encoder')\n"
    )
    program.chmod(0o755)
    with pytest.raises(VolsplatError, match="turn.mp4: ffmpeg could not .*: first words; Unknown encoder$"):
        written(single, scenes_of(single, frames=40), tmp_path / "turn.mp4")
    assert os.listdir(tmp_path) == []


def test_an_ffmpeg_that_is_content_too_early_is_not_believed(
    single: SingleProcess, tmp_path: Path, only_program: Path
) -> None:
    (only_program / "ffmpeg").write_text(f"#!{sys.executable}\n")
    (only_program / "ffmpeg").chmod(0o755)
    with pytest.raises(VolsplatError, match="ended without a word"):
        written(single, scenes_of(single, frames=40), tmp_path / "turn.mp4")


def test_what_cannot_be_written_is_refused_before_anything_is_drawn(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    os.mkfifo(tmp_path / "pipe.mp4")
    for name, cause in {
        "pipe.mp4": "ffmpeg writes no movie into a pipe or a device; give the name of a file",
        "turn.avi": r"cannot write this kind of movie; end the name in .mp4 or .webm, or give a folder \(no dot\)",
        "file": "cannot write this kind of movie",
        "absent/turn.mp4": "there is no folder .*absent; make it first",
        "absent/turn": "there is no folder .*absent; make it first",
        "file/turn": "there is no folder .*file; make it first",
    }.items():
        with pytest.raises(BadInput, match=f"{name}: {cause}"):
            check_movie_writable(tmp_path / name)
    assert sorted(os.listdir(tmp_path)) == ["file", "pipe.mp4"]


def test_scenes_of_two_sizes_make_no_movie(single: SingleProcess, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="one image size, but there are 64x48 and 66x48"):
        written(single, scenes_of(single) + scenes_of(single, (66, 48)), tmp_path / "turn")


# -- the command


@pytest.fixture
def person(tmp_path: Path) -> Person:
    return Person(tmp_path)


def one_line(done: "subprocess.CompletedProcess[str]") -> str:
    lines = done.stderr.splitlines()
    assert len(lines) == 1, done.stderr
    return lines[0]


def test_the_command_turns_a_volume_by_servers_as_by_a_single_process(person: Person, head: Path) -> None:
    for output, options in {"servers": ["--workers", "2"], "single": ["--single"]}.items():
        done = person.runs("movie", str(head), "-o", output, "--frames", "4", "--size", "40x30", *options)
        assert done.returncode == 0, done.stderr
        assert one_line(done).startswith(f"{output}: 4 images of 40x30, ")
    names = sorted(os.listdir(person.folder / "servers"))
    assert names == sorted(os.listdir(person.folder / "single")) and len(names) == 4
    for name in names:
        assert (person.folder / "servers" / name).read_bytes() == (person.folder / "single" / name).read_bytes()
    assert person.servers() == []


def test_the_command_tells_of_a_label_that_no_image_has(person: Person, head: Path) -> None:
    labels = ["--label", "middle@12,16,14", "--label", "away@900,900,900"]
    done = person.runs("movie", str(head), "-o", "labelled", "--frames", "2", "--size", "120x90", "--single", *labels)
    assert done.returncode == 0, done.stderr
    note, _ = done.stderr.splitlines()
    assert note.startswith("note: no image of the movie has the label away: what it points at lies outside all of them")


def test_the_command_draws_what_of_a_prepared_volume_fits_into_its_memory(person: Person, head: Path) -> None:
    store = person.folder / "head.zarr"
    prepare_small(head, store)
    options = ["--frames", "2", "--size", "120x90"]
    for output, more in {
        "servers": ["--workers", "2", "--memory", "50K"],
        "single": ["--single", "--memory", "50K"],
        "plenty": ["--single", "--memory", "1G"],
    }.items():
        done = person.runs("movie", str(store), "-o", output, *options, *more)
        assert done.returncode == 0, done.stderr
    images = sorted(path.name for path in (person.folder / "servers").iterdir())
    with SingleProcess(store, memory=50 << 10) as little:
        for name in images:
            drawn, single, plenty = (person.folder / output / name for output in ("servers", "single", "plenty"))
            assert drawn.read_bytes() == single.read_bytes() != plenty.read_bytes()
            finished = little.finish(read_scene(drawn))
            assert finished.outcome is not None and finished.outcome.servers.level == 1
            shown = over_background(finished.image, (0.0, 0.0, 0.0))
            assert (read_image(drawn) - shown).abs().max() <= HALF_A_LEVEL["uint8"]


def test_the_command_goes_from_key_to_key(person: Person, head: Path, single: SingleProcess) -> None:
    first = msgspec.structs.replace(single.volume.default_scene(), image=Image(width=40, height=30))
    (person.folder / "first.toml").write_text(scene_toml(first))
    (person.folder / "last.toml").write_text("[view]\nzoom = 3.0\n[image]\nwidth = 999\n")
    keys = ["--key", "first.toml", "--key", "last.toml", "--size", "40x30"]
    done = person.runs("movie", str(head), "-o", "keys", "--frames", "3", "--single", *keys)
    assert done.returncode == 0, done.stderr
    shown = [read_scene(path) for path in sorted((person.folder / "keys").iterdir())]
    assert shown[0] == single.volume.settled(single.volume.fitted_to_turn(first))
    assert shown[2].view.zoom == 3.0
    assert isinstance(shown[1].view.zoom, float)


@needs_ffmpeg
def test_the_command_writes_a_film(person: Person, head: Path) -> None:
    options = ["--frames", "5", "--rate", "10", "--size", "40x30", "--axis", "grid-k", "--workers", "1", "--step", "C"]
    done = person.runs("movie", str(head), "-o", "turn.mp4", *options)
    assert done.returncode == 0, done.stderr
    assert len(film_frames(person.folder / "turn.mp4", 40, 30)) == 5


BAD_OPTIONS = {
    "no output": ([], "'-o' / '--output'"),
    "no frames": (["-o", "a", "--frames", "0"], "--frames"),
    "kind": (["-o", "a.gif"], ".webm"),
    "axis": (["-o", "a", "--axis", "up"], "--axis"),
    "axis and keys": (["-o", "a", "--axis", "grid-k", "--key", "k.toml", "--key", "k.toml"], "leave out one"),
    "one key": (["-o", "a", "--key", "k.toml"], "2 keys"),
    "key missing": (["-o", "a", "--key", "none.toml", "--key", "k.toml"], "none.toml"),
    "keys of two sizes": (["-o", "a", "--key", "k.toml", "--key", "large.toml"], "512x512 and 600x512"),
    "folder missing": (["-o", "nowhere/a"], "nowhere"),
    "volume missing": (["-o", "a"], "no such file"),
    "size": (["-o", "a", "--size", "12x"], "--size"),
    "memory": (["-o", "a", "--memory", "much"], "--memory much: give a size such as 800M or 4G"),
}


@pytest.mark.parametrize("case", BAD_OPTIONS)
def test_a_bad_option_is_one_clear_line_and_status_2(person: Person, head: Path, case: str) -> None:
    (person.folder / "k.toml").write_text("")
    (person.folder / "large.toml").write_text("[image]\nwidth = 600\n")
    options, named = BAD_OPTIONS[case]
    volume = "missing.nrrd" if case == "volume missing" else str(head)
    done = person.runs("movie", volume, "--workers", "1", *options)
    assert (done.returncode, named in one_line(done)) == (2, True), done.stderr
    assert sorted(os.listdir(person.folder)) == ["k.toml", "large.toml"]
    assert person.servers() == []


@kinds
def test_a_full_disk_is_one_line_and_status_2_and_leaves_nothing(head: Path, small_disk: Path, kind: str) -> None:
    person = Person(small_disk)
    output = target(small_disk, kind).name
    done = person.runs("movie", str(head), "-o", output, "--frames", "12", "--size", "1024x1024", "--workers", "1")
    *progress, line = done.stderr.splitlines()
    assert all(", about " in told for told in progress), done.stderr
    assert done.returncode == 2 and "No space left on device" in line and ".volsplat" not in line
    assert line.startswith(f"volsplat: {output}")
    assert os.listdir(small_disk) == [] and person.servers() == []


@kinds
@pytest.mark.parametrize("after", [0.1, 0.8, 1.5, 2.2])
def test_ctrl_c_at_any_moment_leaves_nothing(person: Person, head: Path, kind: str, after: float) -> None:
    options = ["--frames", "3000", "--size", "300x300", "--workers", "2"]
    client = person.starts("movie", str(head), "-o", str(target(person.folder, kind)), *options)
    wait_until(lambda: is_under_way(client), "under way")
    with pytest.raises(subprocess.TimeoutExpired):
        client.wait(after)
    ffmpegs = [child for child in psutil.Process(client.pid).children() if child.name() == "ffmpeg"]
    client.send_signal(signal.SIGINT)
    _, said = client.communicate(timeout=PATIENCE)
    assert client.returncode in (INTERRUPTED, -signal.SIGINT), said
    assert "Traceback" not in said
    assert os.listdir(person.folder) == []
    assert not any(ffmpeg.is_running() for ffmpeg in ffmpegs)
    wait_until(lambda: not person.servers(), "without servers")
