"""Random partitions of a volume, and who gets which of its boxes."""

from random import Random

from volsplat.protocol.description.volume import Box


def cut(box: Box, random: Random, cuts: int) -> list[Box]:
    """A random partition of a box: one of its parts is cut in two, over and over."""
    boxes = [box]
    for _ in range(cuts):
        part = boxes.pop(random.randrange(len(boxes)))
        axes = [axis for axis in range(3) if part.size[axis] > 1]
        if not axes:
            boxes.append(part)
            continue
        axis = random.choice(axes)
        at = random.randrange(part.low[axis] + 1, part.high[axis])
        high, low = list(part.high), list(part.low)
        high[axis] = low[axis] = at
        boxes += [Box(part.low, (high[0], high[1], high[2])), Box((low[0], low[1], low[2]), part.high)]
    return boxes


def handed_out(boxes: list[Box], workers: int, random: Random) -> list[list[Box]]:
    """Any box to any worker, who may get none."""
    holdings: list[list[Box]] = [[] for _ in range(workers)]
    for box in boxes:
        random.choice(holdings).append(box)
    return holdings
