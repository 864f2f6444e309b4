"""Fuzzes framing, messages and handshake with atheris: `pip install .[fuzz]`, then

    python tests/fuzz/fuzz_framing.py -max_total_time=600 CORPUS tests/recorded/protocol-1

The invariant is in stream_invariant.py. The first byte chooses who speaks to whom, the rest is what they say.
"""

import sys

import atheris

with atheris.instrument_imports(include=["volsplat.protocol"]):
    from stream_invariant import WAYS, check_handshakes, check_stream


def test_one_input(data: bytes) -> None:
    if not data:
        return
    way, said = WAYS[data[0] % len(WAYS)], data[1:]
    if way is None:
        check_handshakes(said)
    else:
        check_stream(said, way)


def main() -> None:
    atheris.Setup(sys.argv, test_one_input)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
