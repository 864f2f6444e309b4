"""Numbers of bytes as people read them."""

from hypothesis import given
from hypothesis import strategies as st

from volsplat.protocol.text.byte_sizes import ON_DISK, size_on_disk


@given(count=st.one_of(st.integers(0, 10**18 // 2), st.sampled_from([999, 1000, 999_499, 999_500, 999_600])))
def test_a_size_has_three_digits_of_its_bytes_and_no_power_of_ten(count: int) -> None:
    number, unit = size_on_disk(count).split()
    assert "e" not in number and len(number.replace(".", "")) <= 4
    assert float(number) < 1000
    assert abs(float(number) * 1000 ** ON_DISK.index(unit) - count) <= 0.0051 * count
