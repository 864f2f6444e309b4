"""A volume's place in space that nothing can be computed with is refused for what it is."""

import pytest

from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry.matrices import Matrix


def along(i: float, j: float, k: float) -> Matrix:
    return ((i, 0.0, 0.0), (0.0, j, 0.0), (0.0, 0.0, k))


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        (along(1e150, 1e150, 1e150), "of a size that float64 can compute with"),
        (along(1e-160, 1e-160, 1e-160), "of a size that float64 can compute with"),
        (along(1e-110, 1e-110, 1e-110), "of a size that float64 can compute with"),
        (along(float("nan"), 1.0, 1.0), "of a size that float64 can compute with"),
        (along(1.0, 1.0, 0.0), "do not span space: one has spacing 0"),
        (((1.0, 1.0, 0.0), (1.0, 1.0, 0.0), (0.0, 0.0, 1.0)), "do not span space; index_to_physical is"),
    ],
)
def test_a_place_without_space_or_of_no_size_is_told_apart(matrix: Matrix, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Geometry((2, 2, 2), matrix)
