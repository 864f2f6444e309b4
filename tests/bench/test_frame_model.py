"""The model of a frame's time says what follows from its own words."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from volsplat.deploy.frame_model import (
    CODED_SHARE,
    FEWEST_SERVERS,
    TELLING,
    Cluster,
    Load,
    Prediction,
    Rates,
    predicted,
)

LOAD = Load(voxels=16e6, packets=2e6, pixels=128e6, footprint_lines=8, lines=480, image_bytes=4e6)
RATES = Rates(voxel=0.3e-9, packet=3e-9, splat=5e-9, pixel=0.2e-9, frame=1e-3)
ALONE = Cluster(workers=1, walkers=1, splat_servers=1, owners=1, cores=1)
counts = st.integers(1, 64)
clusters = st.builds(Cluster, counts, counts, counts, counts, counts, st.none() | st.floats(1e6, 1e11))


def test_one_thread_does_one_thing_after_the_other() -> None:
    took = 16e6 * 0.3e-9 + 2e6 * (3e-9 + 5e-9) + 128e6 * 0.2e-9
    assert predicted(LOAD, RATES, ALONE).seconds == pytest.approx(took + 1e-3)


@given(clusters)
def test_faster_links_and_more_cores_never_slow_a_frame(cluster: Cluster) -> None:
    more = Cluster(
        cluster.workers,
        cluster.walkers,
        cluster.splat_servers,
        cluster.owners,
        2 * cluster.cores,
        cluster.bits_per_second and 2 * cluster.bits_per_second,
    )
    assert predicted(LOAD, RATES, more).seconds <= predicted(LOAD, RATES, cluster).seconds


def test_slow_links_bound_a_frame_by_their_bytes() -> None:
    slow = Cluster(workers=4, walkers=1, splat_servers=1, owners=1, cores=1, bits_per_second=100e6)
    found = predicted(LOAD, RATES, slow)
    assert found.limit == "links into splat servers"
    on_links = (CODED_SHARE * LOAD.batch_bytes + LOAD.image_bytes) * 8 / 100e6
    assert found.seconds == pytest.approx(on_links + (4 + 1 - FEWEST_SERVERS) * TELLING + RATES.frame)


def test_a_client_of_many_servers_is_what_limits_a_frame() -> None:
    def found(workers: int) -> Prediction:
        return predicted(LOAD, RATES, Cluster(workers, 64, 1, 64, 64, 1e15))

    assert found(2).limit != "the client" == found(200).limit
    assert found(200).seconds - found(199).seconds == pytest.approx(TELLING)


def test_batches_are_coded_only_where_links_are_slower_than_the_coder() -> None:
    def took(bits_per_second: float) -> float:
        return predicted(LOAD, RATES, Cluster(4, 1, 4, 1, 1, bits_per_second)).seconds

    walking = (LOAD.voxels * RATES.voxel + LOAD.packets * (1 + LOAD.twice(4)) * RATES.packet) / 4
    splatting = (LOAD.packets * (1 + LOAD.twice(4)) * RATES.splat + LOAD.pixels * RATES.pixel) / 4
    after = LOAD.image_bytes * 8 / 1e12 + (4 + 4 - FEWEST_SERVERS) * TELLING + RATES.frame
    assert took(1e12) == pytest.approx(max(walking, splatting) + after)
    assert took(100e6) < LOAD.batch_bytes * 8 / 100e6 / 4 + LOAD.image_bytes * 8 / 100e6


@given(counts)
def test_what_reaches_two_regions_is_never_more_than_all(regions: int) -> None:
    assert 0 <= LOAD.twice(regions) <= 1 and math.isclose(LOAD.twice(1), 0)
