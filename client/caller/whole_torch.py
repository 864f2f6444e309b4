"""Torch, whole or not at all."""

from volsplat.client.caller.interrupts import interrupts_held
from volsplat.program.extras import need


def load_torch(purpose: str) -> None:
    """Have it loaded, for more than a second, by whoever asks for a tensor. Raises BadInput without the extra [torch].

    Ctrl-C meanwhile waits for that: half loaded it cannot be loaded again, for as long as the process lives.
    """
    need("torch", purpose, "torch")
    with interrupts_held():
        import torch  # noqa: F401
