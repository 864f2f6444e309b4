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


class FinestStep(StrEnum):
    """Those that a refinement may end with."""

    F = "F"
    G = "G"


FINEST_WORDS = {FinestStep.F: "refine to F", FinestStep.G: "refine to G"}
