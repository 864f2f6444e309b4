"""Random scenes for property tests: every key in every form that it may take."""

from hypothesis import strategies as st

from volsplat.protocol.description.scene import (
    Bounds,
    Image,
    Kernel,
    Light,
    Quantise,
    Reconstruction,
    Refine,
    Scene,
    Shading,
    View,
)
from volsplat.protocol.description.shading_tables import ColourTable, CrossBar, ScalarTable, Tables

units = st.floats(0, 1)
hex_channels = st.integers(0, 255).map(lambda n: n / 255)
colours = st.tuples(units, units, units) | st.tuples(hex_channels, hex_channels, hex_channels)
finite = st.floats(-1e300, 1e300)
voxels = st.integers(0, 2**40)


def _positions(count: int) -> st.SearchStrategy[list[float]]:
    return st.lists(units, min_size=count, max_size=count).map(sorted)


@st.composite
def colour_tables(draw: st.DrawFn) -> ColourTable:
    entries = draw(st.lists(colours, min_size=1, max_size=5))
    return ColourTable(points=tuple(zip(draw(_positions(len(entries))), entries, strict=True)))


@st.composite
def scalar_tables(draw: st.DrawFn) -> ScalarTable:
    entries = draw(st.lists(units, min_size=1, max_size=5))
    return ScalarTable(points=tuple(zip(draw(_positions(len(entries))), entries, strict=True)))


def scenes() -> st.SearchStrategy[Scene]:
    """Any scene that checks itself successfully; not every one fits every volume."""
    vectors = st.tuples(finite, finite, finite)
    windows = st.tuples(finite, finite).filter(lambda window: window[1] - window[0] > 1e-300)
    return st.builds(
        Scene,
        tables=st.builds(
            Tables, emit=colour_tables(), refl=colour_tables(), opac=scalar_tables(), modu=scalar_tables()
        ),
        cross_bar=st.builds(CrossBar),
        shading=st.builds(Shading, specular_power=st.floats(0, 1000, exclude_min=True)),
        light=st.builds(
            Light,
            direction=vectors.filter(any),
            shadows=st.floats(0, 1),
            occlusion=st.floats(0, 1),
            depth_cue=st.floats(0, 1),
            silhouettes=st.floats(0, 1),
        ),
        view=st.builds(
            View,
            rotation=st.tuples(finite, finite, finite, finite).filter(any),
            zoom=st.just("fit") | st.floats(1 / 64, 256),
            center=st.just("middle") | vectors,
        ),
        bounds=st.builds(
            Bounds,
            low=st.tuples(voxels, voxels, voxels),
            high=st.just((-1, -1, -1)) | st.tuples(voxels, voxels, voxels),
        ),
        reconstruction=st.builds(
            Reconstruction, kernel=st.sampled_from(Kernel), radius=st.just("default") | st.floats(1, 4)
        ),
        refine=st.builds(Refine),
        image=st.builds(
            Image, width=st.integers(1, 16384), height=st.integers(1, 16384), background=colours, edges=st.booleans()
        ),
        quantise=st.builds(Quantise, window=st.just("auto") | windows),
    )
