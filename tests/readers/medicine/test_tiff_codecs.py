"""TIFF as microscopes and archives pack it: what imagecodecs, of the extra [formats], decodes."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from support.files.volume_files import values_of
from volsplat.mapshade_server.readers import open_volume
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import BadInput

tifffile = pytest.importorskip("tifffile")
pytest.importorskip("imagecodecs")

LOSSLESS = ("zstd", "jpeg2000", "lzw", "packbits")


@pytest.mark.parametrize("tile", [None, (16, 16)])
@pytest.mark.parametrize("scalar_type", ["uint8", "uint16"])
@pytest.mark.parametrize("codec", LOSSLESS)
def test_lossless_codecs_come_back(
    codec: str, scalar_type: str, tile: tuple[int, int] | None, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    values = values_of(scalar_type, (40, 30, 3))
    path = tmp_path / "volume.tif"
    level = {"compressionargs": {"level": 0}} if codec == "jpeg2000" else {}  # 0 is lossless
    tifffile.imwrite(path, values, compression=codec, photometric="minisblack", tile=tile, **level)
    reader = open_volume(str(path))
    assert reader.description.geometry.dims == (40, 30, 3)
    np.testing.assert_array_equal(reader.read(reader.description.geometry.box), values)
    np.testing.assert_array_equal(reader.read(Box((3, 4, 1), (29, 20, 3))), values[1:3, 4:20, 3:29])
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("codec", ["zstd", "lzw"])
def test_a_predictor_before_a_codec_is_reversed(codec: str, tmp_path: Path) -> None:
    values = values_of("uint16", (40, 30, 3))
    tifffile.imwrite(tmp_path / "v.tif", values, compression=codec, predictor=True, photometric="minisblack")
    reader = open_volume(str(tmp_path / "v.tif"))
    np.testing.assert_array_equal(reader.read(reader.description.geometry.box), values)


@pytest.mark.parametrize("codec", ["jpegxl", "lerc", "ccittfax4"])
def test_a_codec_whose_size_nobody_can_check_is_refused_with_the_cure(codec: str, tmp_path: Path) -> None:
    if codec == "ccittfax4":  # which imagecodecs only decodes
        pages = [Image.fromarray(plane > 9) for plane in values_of("uint8", (40, 30, 3))]
        pages[0].save(tmp_path / "v.tif", save_all=True, append_images=pages[1:], compression="group4")
    else:
        values = values_of("uint8", (40, 30, 3))
        tifffile.imwrite(tmp_path / "v.tif", values, compression=codec, photometric="minisblack")
    reader = open_volume(str(tmp_path / "v.tif"))
    with pytest.raises(BadInput, match=f"page 0 is packed by {codec.upper()}, which is not read.*zstd") as refused:
        reader.read(reader.description.geometry.box)
    assert "\n" not in str(refused.value)
