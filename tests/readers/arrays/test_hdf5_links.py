"""HDF5 datasets by links: out of a group, from file to file, in circles, to nothing; and what NeXus says by them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.files.opened import described, read_whole
from support.files.volume_files import values_of
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.reading.parts import PartNeeded
from volsplat.protocol.text.errors import BadInput

h5py = pytest.importorskip("h5py")

VALUES = values_of("int16")


def written(path: Path, fill: Callable[[Any], object]) -> Path:
    with h5py.File(path, "w") as file:
        fill(file)
    return path


def linked_plot(file: Any) -> None:
    """As beamlines write it: the plot's signal and an axis are links to where a detector wrote them."""
    file["entry/camera/frames"], file["entry/camera/dark"] = VALUES, VALUES * 0
    file["entry/camera/rows"] = np.arange(VALUES.shape[1]) * 0.5
    plot = file.create_group("entry/plot")
    plot["data"], plot["row"] = h5py.SoftLink("/entry/camera/frames"), h5py.SoftLink("/entry/camera/rows")
    plot.attrs.update({"signal": "data", "axes": [".", "row", "."]})
    file.attrs["default"], file["entry"].attrs["default"] = "entry", "plot"


@pytest.mark.parametrize("part", ["", "#entry/plot", "#entry/plot/data"])
def test_what_nexus_plots_by_a_link_has_the_axes_that_lie_beside_the_link(part: str, tmp_path: Path) -> None:
    name = f"{written(tmp_path / 'v.nxs', linked_plot)}{part}"
    np.testing.assert_array_equal(read_whole(name), VALUES)
    assert described(name).geometry.spacing == (1, 0.5, 1)


@pytest.mark.parametrize(("default", "signal"), [("entry/plot", "/entry/plot/data"), ("/entry//plot/", "./data")])
def test_what_nexus_plots_has_one_name_however_that_is_written(default: str, signal: str, tmp_path: Path) -> None:
    def fill(file: Any) -> None:
        file["entry/plot/data"], file.attrs["default"] = VALUES, default
        file["entry/plot"].attrs["signal"] = signal

    assert described(written(tmp_path / "v.nxs", fill)).format == "HDF5 dataset /entry/plot/data"


@pytest.mark.parametrize("axes", [".:row:.", "., row, .", "[.,row,.]"])
def test_nexus_may_name_axes_in_one_text(axes: str, tmp_path: Path) -> None:
    def fill(file: Any) -> None:
        file["data"], file["row"] = VALUES, np.arange(VALUES.shape[1]) * 0.5
        file.attrs["axes"] = axes

    assert described(written(tmp_path / "v.nxs", fill)).geometry.spacing == (1, 0.5, 1)


@pytest.mark.parametrize("default", [".", "/", "me", "group"])
def test_a_group_that_nexus_has_plot_itself_ends_in_a_choice(default: str, tmp_path: Path) -> None:
    def fill(file: Any) -> None:
        file["group/a"], file["group/b"], file["me"] = VALUES, VALUES, h5py.SoftLink("/")
        file.attrs["default"], file["group"].attrs["default"] = default, "."

    with pytest.raises(PartNeeded):
        open_volume(str(written(tmp_path / "v.nxs", fill)))


def test_a_group_of_links_to_other_files_that_a_link_leads_to_is_gone_through(tmp_path: Path) -> None:
    written(tmp_path / "leaf.h5", lambda file: file.create_dataset("data", data=VALUES))
    written(tmp_path / "mid.h5", lambda file: file.__setitem__("plot/far", h5py.ExternalLink("leaf.h5", "/data")))
    top = written(tmp_path / "top.h5", lambda file: file.__setitem__("way", h5py.ExternalLink("mid.h5", "/plot")))
    np.testing.assert_array_equal(read_whole(top), VALUES)
    assert described(top).format == "HDF5 dataset /way/far"


def test_however_many_links_lead_into_a_file_it_is_opened_as_often(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To close it h5py goes through all that is open, so that the time would grow with the square of the links."""
    closed = list[str]()
    close = h5py.File.close

    def counts(file: Any) -> None:
        closed.append(file.filename if file else "")
        close(file)

    monkeypatch.setattr(h5py.File, "close", counts)

    def times_closed(links: int) -> int:
        folder = tmp_path / str(links)
        folder.mkdir()

        def fill(file: Any) -> None:
            file["far"] = h5py.ExternalLink("leaf.h5", "/")
            for n in range(links):
                file[f"plot/{n}"] = h5py.SoftLink(f"/far/{n}")

        written(folder / "leaf.h5", lambda file: [file.__setitem__(str(n), VALUES + n) for n in range(links)])
        written(folder / "mid.h5", fill)
        top = written(folder / "top.h5", lambda file: file.__setitem__("way", h5py.ExternalLink("mid.h5", "/plot")))
        closed.clear()
        with pytest.raises(PartNeeded) as needed:
            open_volume(str(top))
        assert len(needed.value.parts) == links
        np.testing.assert_array_equal(read_whole(f"{top}#way/1"), VALUES + 1)
        return len(closed)

    assert times_closed(30) == times_closed(3)


def round_in_circles(file: Any) -> None:
    file["data"] = VALUES
    file["a"], file["b"] = h5py.SoftLink("/b"), h5py.SoftLink("/a")
    file["out"], file["whole"] = h5py.ExternalLink("v.h5", "/out"), h5py.ExternalLink("v.h5", "/")
    file["group/me"], file["group/a"] = h5py.SoftLink("/group"), h5py.SoftLink("/a")
    file.attrs["axes"] = ["a", "out", "group"]


@pytest.mark.parametrize("part", ["", "#group/me/me", "#whole/whole/data"])
def test_links_in_circles_keep_nothing_from_being_read(part: str, tmp_path: Path) -> None:
    name = f"{written(tmp_path / 'v.h5', round_in_circles)}{part}"
    if "group" not in part:
        np.testing.assert_array_equal(read_whole(name), VALUES)
        return
    with pytest.raises(BadInput, match="holds no dataset with three axes"):
        open_volume(name)


@pytest.mark.parametrize(
    ("link", "told"),
    [
        (h5py.SoftLink("/gone"), "is a link to /gone, which leads nowhere; choose"),
        (h5py.SoftLink("/lost"), "is a link to /lost, which leads nowhere; choose"),
        (h5py.ExternalLink("gone.h5", "/a"), "is a link to /a of gone.h5, which is not there, or lacks that; put"),
        (h5py.ExternalLink("v.h5", "/gone"), "is a link to /gone of v.h5, which is not there, or lacks that; put"),
    ],
)
def test_a_link_that_leads_nowhere_says_where_that_would_be(link: Any, told: str, tmp_path: Path) -> None:
    path = written(tmp_path / "v.h5", lambda file: file.__setitem__("lost", link))
    with pytest.raises(BadInput) as refused:
        open_volume(f"{path}#lost")
    assert f"{path}#lost: {told}" in str(refused.value)
