"""The 2-D histogram: the very bytes that pictures are drawn from, counted the same however the volume is divided."""

from pathlib import Path

import torch
from hypothesis import given
from hypothesis import strategies as st

from reference import voxel_packets
from support.files.head_volume import head, scene, single
from support.scenes.arbitrary import geometries
from support.scenes.shadings import partitions, quantisations, volumes
from volsplat.client import Session
from volsplat.client.histogram.plane_counts import PlaneCounts
from volsplat.client.session.single import SingleProcess
from volsplat.mapshade_server.answers.volume_answers import plane_counts
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.packet_layout import NO_DATA_BIT

__all__ = ["head", "scene", "single"]


@given(data=st.data(), geometry=geometries(), quantisation=quantisations())
def test_counts_are_those_of_the_reference_from_any_partition(
    data: st.DataObject, geometry: Geometry, quantisation: Quantisation
) -> None:
    values = data.draw(volumes(geometry))
    counts = PlaneCounts()
    for box in data.draw(partitions(geometry)):
        cube = SubCube.of_volume(geometry, values, box)
        cube.pack(quantisation)
        counts = counts.plus(plane_counts([cube]))
    packets = voxel_packets.pack(values, geometry, quantisation).flatten()
    there = packets[packets >> NO_DATA_BIT == 0]
    assert list(counts.counts) == torch.bincount(there & 0xFFFF, minlength=65536).tolist()
    assert counts.voxels == len(there)


def test_sessions_and_the_single_process_count_the_same(head: Path, single: SingleProcess, scene: Scene) -> None:
    alone = single.plane_counts(scene)
    with Session(head, workers=3) as session:
        assert session.plane_counts(scene) == alone
        narrow = scene.with_(window=(0.0, 100.0))
        assert session.plane_counts(narrow) == single.plane_counts(narrow) != alone
    assert alone.voxels == single.volume.description.geometry.box.voxels
