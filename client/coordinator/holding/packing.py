"""Which packets frames are drawn from."""

from dataclasses import dataclass, field, replace

from volsplat.protocol.rules.index_rules import Quantisation


@dataclass(frozen=True)
class Packing:
    """What packets are held or wanted: by which rules they were made; of a prepared volume, from which level on."""

    quantisation: Quantisation
    base_level: int = 0  # that the finest step draws
    level: int = 0  # the finest of all; the base level is read last, when the first pictures are there
    why_level: str = field(default="", compare=False)  # for a person; "" where there is only one

    def serves(self, wanted: "Packing") -> bool:
        """Whether these packets, held, are all that is wanted."""
        return replace(wanted, level=self.level) == self and self.level <= wanted.level
