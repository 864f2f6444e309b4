"""The steps of successive refinement, by their names; what each does is a matter of rules/refinement."""

from enum import StrEnum


class Step(StrEnum):
    """The paper's six steps of successive refinement, and G, which classifies and lights what it has reconstructed."""

    A = "A"
    B = "B"
    C = "C"
    D = "D"
    E = "E"
    F = "F"
    G = "G"


class PaperStep(StrEnum):
    """Those of the paper."""

    A = "A"
    B = "B"
    C = "C"
    D = "D"
    E = "E"
    F = "F"
