"""Fuzzes framing, messages and handshake with atheris: `pip install .[fuzz]`, then, in tests/,

    python -m fuzz.fuzz_framing -max_total_time=600 CORPUS

The invariant is in stream_invariant.py. The first byte of an input chooses who speaks to whom, the rest is what they
say. CORPUS is a folder, which begins with the recorded messages.
"""

import sys
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["volsplat.protocol"]):
    from fuzz.stream_invariant import WAYS, check_handshakes, check_stream


def test_one_input(data: bytes) -> None:
    if not data:
        return
    way, said = WAYS[data[0] % len(WAYS)], data[1:]
    if way is None:
        check_handshakes(said)
    else:
        check_stream(said, way)


def plant_recorded_messages(corpus: Path) -> None:
    corpus.mkdir(parents=True, exist_ok=True)
    for path in (Path(__file__).parents[1] / "recorded").glob("*/*.bin"):
        for number in range(len(WAYS)):
            (corpus / f"{path.parent.name}-{path.stem}-{number}").write_bytes(bytes([number]) + path.read_bytes())


def main() -> None:
    for argument in sys.argv[1:]:
        if not argument.startswith("-"):
            plant_recorded_messages(Path(argument))
    atheris.Setup(sys.argv, test_one_input)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
