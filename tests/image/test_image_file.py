"""Image files: exact pixels, the scene inside, equal bytes for equal images, and never half a file."""

import base64
import os
import resource
import stat
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import OpenImageIO as oiio
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from support.files.images import over_background, read_image
from support.files.small_disks import small_disk
from support.scenes.scenes import scenes
from support.thoroughness import examples
from tolerances import HALF_A_LEVEL, JPEG_LEVELS
from volsplat.client.image import image_file
from volsplat.client.image.image_file import read_properties, read_scene, write_pixels
from volsplat.client.image.image_file import write_image as write
from volsplat.client.image.image_formats import IMAGE_FORMATS, check_writable
from volsplat.protocol.description.scene import Image, Scene
from volsplat.protocol.description.shading_tables import ColourTable, ScalarTable, Tables
from volsplat.protocol.text.errors import BadInput

__all__ = ["small_disk"]

SCENE = Scene(
    tables=Tables(
        emit=ColourTable(points=((0.0, (0.0, 0.0, 0.0)), (1.0, (1.0, 0.5, 0.25)))),
        refl=ColourTable(points=((0.0, (1.0, 1.0, 1.0)),)),
        opac=ScalarTable(points=((0.25, 0.0), (1.0, 0.5))),
    ),
    image=Image(width=7, height=5, background=(0.25, 0.5, 1.0)),
)


def picture(height: int = 5, width: int = 7, seed: int = 1) -> torch.Tensor:
    """Any image with associated alpha: no channel exceeds alpha."""
    generator = torch.Generator().manual_seed(seed)
    alpha = torch.rand((height, width, 1), generator=generator)
    return torch.cat([torch.rand((height, width, 3), generator=generator) * alpha, alpha], dim=2)


def smooth_picture() -> torch.Tensor:
    ramp = torch.linspace(0, 1, 64).expand(64, 64)
    return torch.stack([ramp, ramp.T, 0.5 * ramp, torch.ones(64, 64)], dim=2)


def test_exr_keeps_every_bit_and_alpha_without_background(tmp_path: Path) -> None:
    path = tmp_path / "image.exr"
    write(path, picture(), SCENE)
    assert torch.equal(read_image(path), picture())


@pytest.mark.parametrize("kind", [".png", ".tif", ".tiff"])
def test_the_background_lies_under_opaque_formats_within_half_a_level(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"image{kind}"
    write(path, picture(), SCENE)
    expected = over_background(picture(), SCENE.image.background)
    assert read_image(path).shape == (5, 7, 3)
    assert (read_image(path) - expected).abs().max() <= HALF_A_LEVEL["uint8"]


@pytest.mark.parametrize("kind", [".png", ".tif", ".exr"])
def test_an_image_of_several_blocks_is_whole_and_in_order(tmp_path: Path, kind: str) -> None:
    tall = picture(height=3 * image_file._BLOCK_ROWS + 5, width=image_file._BLOCK_PIXELS // image_file._BLOCK_ROWS + 1)
    write(tmp_path / f"tall{kind}", tall, SCENE)
    stored = read_image(tmp_path / f"tall{kind}")
    expected = tall if kind == ".exr" else over_background(tall, SCENE.image.background)
    assert stored.shape == expected.shape
    assert (stored - expected).abs().max() <= HALF_A_LEVEL["float" if kind == ".exr" else "uint8"]


def test_a_jpeg_is_close(tmp_path: Path) -> None:
    path = tmp_path / "image.jpg"
    write(path, smooth_picture(), SCENE)
    assert (read_image(path) - smooth_picture()[..., :3]).abs().max() <= JPEG_LEVELS


def test_a_jpeg_of_lower_quality_is_smaller(tmp_path: Path) -> None:
    write_pixels(tmp_path / "good.jpg", smooth_picture()[..., :3])
    write_pixels(tmp_path / "poor.jpg", smooth_picture()[..., :3], jpeg_quality=20)
    assert (tmp_path / "poor.jpg").stat().st_size < (tmp_path / "good.jpg").stat().st_size


@settings(max_examples=examples(10))
@given(scene=scenes())
@pytest.mark.parametrize("kind", IMAGE_FORMATS)
def test_the_scene_comes_back_out_of_every_format(
    tmp_path_factory: pytest.TempPathFactory, kind: str, scene: Scene
) -> None:
    path = tmp_path_factory.mktemp("scene") / f"image{kind}"
    write(path, picture(), scene, {"step": "F"})
    assert read_scene(path) == scene
    assert read_properties(path)["step"] == "F"


@pytest.mark.parametrize("kind", IMAGE_FORMATS)
def test_freehand_tables_fit_into_every_format(tmp_path: Path, kind: str) -> None:
    values = torch.rand((256, 3), generator=torch.Generator().manual_seed(2), dtype=torch.float64).tolist()
    colours = ColourTable(points=tuple((n / 255, (r, g, b)) for n, (r, g, b) in enumerate(values)))
    scalars = ScalarTable(points=tuple((n / 255, r) for n, (r, _, _) in enumerate(values)))
    scene = Scene(tables=Tables(emit=colours, refl=colours, opac=scalars, modu=scalars))
    write(tmp_path / f"image{kind}", picture(), scene)
    assert read_scene(tmp_path / f"image{kind}") == scene


def test_a_scene_too_large_for_a_jpeg_is_refused_and_nothing_written(tmp_path: Path) -> None:
    values = torch.rand(20000, generator=torch.Generator().manual_seed(2), dtype=torch.float64).sort().values.tolist()
    table = ScalarTable(points=tuple((value, value) for value in values))
    with pytest.raises(BadInput, match="too many points for a JPEG"):
        write(
            tmp_path / "image.jpg",
            picture(),
            Scene(tables=Tables(emit=SCENE.tables.emit, refl=SCENE.tables.refl, opac=table)),
        )
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("kind", IMAGE_FORMATS)
def test_equal_images_give_equal_bytes(tmp_path: Path, kind: str) -> None:
    for name in ("one", "two"):
        write(tmp_path / (name + kind), picture(), SCENE)
    first = (tmp_path / f"one{kind}").read_bytes()
    assert first == (tmp_path / f"two{kind}").read_bytes()
    opened = oiio.ImageInput.open(str(tmp_path / f"one{kind}"))
    assert opened is not None
    assert "DateTime" not in [attribute.name for attribute in opened.spec().extra_attribs]


def test_a_new_image_replaces_an_old_one_and_leaves_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "image.png"
    write(path, picture(seed=1), SCENE)
    write(path, picture(seed=2), SCENE)
    assert os.listdir(tmp_path) == ["image.png"]
    assert (read_image(path) - over_background(picture(seed=2), SCENE.image.background)).abs().max() <= HALF_A_LEVEL[
        "uint8"
    ]


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "link.png").symlink_to(tmp_path / "image.png")
    write(tmp_path / "link.png", picture(), SCENE)
    assert (tmp_path / "link.png").is_symlink()
    assert read_scene(tmp_path / "image.png") == SCENE


@pytest.mark.parametrize("kind", IMAGE_FORMATS)
def test_a_pipe_gets_the_bytes_of_a_file_and_stays_a_pipe(tmp_path: Path, kind: str) -> None:
    pipe, file = tmp_path / f"pipe{kind}", tmp_path / f"file{kind}"
    os.mkfifo(pipe)
    with open(os.open(pipe, os.O_RDONLY | os.O_NONBLOCK), "rb") as reading:
        for path in (pipe, file):
            write(path, picture(), SCENE)
        assert reading.read() == file.read_bytes()
    assert pipe.is_fifo() and len(os.listdir(tmp_path)) == 2


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o666])
def test_whom_an_old_image_was_hidden_from_does_not_see_the_new_one(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "image.png"
    path.touch()
    path.chmod(mode)
    (tmp_path / "link.png").symlink_to(path)
    for name in ("image.png", "link.png"):
        write(tmp_path / name, picture(), SCENE)
        assert stat.S_IMODE(path.stat().st_mode) == mode


def test_a_failed_write_keeps_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "image.png"
    path.write_bytes(b"precious")

    def no_space(source: Path, target: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", no_space)
    with pytest.raises(BadInput, match="image.png: cannot write the image: No space left on device"):
        write(path, picture(), SCENE)
    assert path.read_bytes() == b"precious"
    assert os.listdir(tmp_path) == ["image.png"]


@contextmanager
def little_space(size: int) -> Iterator[None]:
    """No file may grow beyond `size` bytes: writing more fails, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("kind", [".png", ".tif", ".exr"])
@pytest.mark.parametrize("size", [0, 10, 4096, 60000])
def test_a_full_disk_is_told_and_leaves_nothing(tmp_path: Path, kind: str, size: int) -> None:
    path = tmp_path / f"image{kind}"
    with little_space(size), pytest.raises(BadInput, match=f"image{kind}: cannot write the image: File too large"):
        write(path, picture(256, 256), SCENE)
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("kind", [".png", ".jpg", ".tif", ".exr"])
def test_no_space_left_is_said_so(small_disk: Path, kind: str) -> None:
    """Also of JPEG, whose library would end the process."""
    with pytest.raises(BadInput) as told:
        write(small_disk / f"image{kind}", torch.rand(256, 256, 4), SCENE)
    assert str(told.value) == f"{small_disk / f'image{kind}'}: cannot write the image: No space left on device"
    assert os.listdir(small_disk) == []


def test_what_cannot_be_written_is_refused_before_rendering(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "folder.png").mkdir()
    for name, cause in {
        "image.gif": "cannot write this kind of image; end the name in one of .png, .jpg",
        "image": "cannot write this kind of image",
        "folder.png": "is a folder",
        "absent/image.png": "there is no folder .*absent; make it first",
        "file/image.png": "there is no folder .*file; make it first",
    }.items():
        with pytest.raises(BadInput, match=f"{name}: {cause}"):
            check_writable(tmp_path / name)
    check_writable(tmp_path / "image.PNG")
    assert sorted(os.listdir(tmp_path)) == ["file", "folder.png"]


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="needs a folder that nobody can write to: /proc")
def test_a_folder_without_permission_is_refused() -> None:
    with pytest.raises(BadInput, match="cannot write into the folder /proc"):
        check_writable(Path("/proc/image.png"))


def test_what_is_not_an_image_of_ours_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "text.png").write_text("no image")
    with pytest.raises(BadInput, match="text.png: cannot read the image"):
        read_scene(tmp_path / "text.png")
    with pytest.raises(BadInput, match="absent.png: no such image file"):
        read_scene(tmp_path / "absent.png")


@settings(max_examples=examples(50))
@given(text=st.text(st.characters(codec="ascii", exclude_characters="\0")))
def test_a_foreign_description_is_no_scene(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    path = tmp_path_factory.mktemp("foreign") / "image.tif"
    buffer = oiio.ImageBuf(oiio.ImageSpec(2, 2, 3, "uint8"))
    buffer.specmod().attribute("ImageDescription", text)
    assert buffer.write(str(path))
    with pytest.raises(BadInput, match="holds no scene"):
        read_scene(path)


@pytest.mark.parametrize(("blanks", "found"), [(1 << 20, {"scene": "any"}), (1 << 26, {})])
def test_a_packed_description_is_unpacked_so_far_and_no_further(
    tmp_path: Path, blanks: int, found: dict[str, str]
) -> None:
    """A picture may come from anybody, and a few kilobytes may unpack to gigabytes."""
    packed = zlib.compress(b'{"volsplat:scene": "any"}' + b" " * blanks)
    buffer = oiio.ImageBuf(oiio.ImageSpec(2, 2, 3, "uint8"))
    buffer.specmod().attribute("ImageDescription", "zlib,base64:" + base64.b64encode(packed).decode())
    assert buffer.write(str(tmp_path / "image.tif"))
    assert read_properties(tmp_path / "image.tif") == found


def test_a_damaged_scene_is_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "image.png"
    write(path, picture(), SCENE, {"scene": '{"order": "sideways"}'})
    with pytest.raises(BadInput, match="the scene stored in it cannot be used") as raised:
        read_scene(path)
    assert "\n" not in str(raised.value)
