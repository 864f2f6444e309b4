"""The steps of successive refinement, as a table (paper: "Successive Refinement"; design, section 6)."""

from dataclasses import dataclass
from itertools import pairwise

from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.scene_keys import KEYS


@dataclass(frozen=True)
class StepRule:
    stride: int  # every n-th sample on each axis is visited
    footprint: bool  # False: nearest pixel
    slabs: bool = False  # classified and lit after reconstruction

    @property
    def octaves(self) -> int:
        """How often the grid is halved by that."""
        return self.stride.bit_length() - 1


STEP_RULES = {
    Step.A: StepRule(stride=4, footprint=False),
    Step.B: StepRule(stride=2, footprint=False),
    Step.C: StepRule(stride=1, footprint=False),
    Step.D: StepRule(stride=1, footprint=True),
    Step.E: StepRule(stride=1, footprint=True),
    Step.F: StepRule(stride=1, footprint=True),
    Step.G: StepRule(stride=1, footprint=False, slabs=True),
}

PAPER_STEPS = tuple(step for step, rule in STEP_RULES.items() if not rule.slabs)

FINEST = "refine.finest"  # the key that changes no step's picture, only which ones are drawn

GREATEST_STRIDE = max(rule.stride for rule in STEP_RULES.values())


def finest_step(scene: Scene) -> Step:
    """The one that refinement ends with if nobody names another."""
    return scene.refine.finest


def finest_paper_step(scene: Scene) -> Step:
    """The finest of the paper's that the scene asks for: none after it is drawn while things move."""
    return min(finest_step(scene), PAPER_STEPS[-1])


def finer(step: Step, finest: Step) -> Step | None:
    """The step that follows; None after the finest."""
    return _neighbour(step, 1) if step < finest else None


def coarser(step: Step) -> Step | None:
    """The step before; None before A."""
    return _neighbour(step, -1)


def _neighbour(step: Step, by: int) -> Step | None:
    steps = list(Step)
    n = steps.index(step) + by
    return steps[n] if 0 <= n < len(steps) else None


@dataclass(frozen=True)
class ActiveShading:
    """Which intensities a step adds up."""

    emitted: bool
    diffuse: bool
    specular: bool


def active_shading(scene: Scene, step: Step) -> ActiveShading:
    """The parts of the shading rules in force at `step`.

    Diffuse joins at `refine.lit_from`, specular one step later but never before F unless lighting was asked for
    earlier; a scene with no emission is lit from A.
    """
    shading = scene.shading
    dark = not shading.emitted or _emits_nothing(scene)
    diffuse_from = Step.A if dark else scene.refine.lit_from
    specular_from = Step.F if diffuse_from == Step.E else diffuse_from
    return ActiveShading(
        emitted=shading.emitted,
        diffuse=shading.diffuse and step >= diffuse_from,
        specular=shading.specular and step >= specular_from,
    )


def same_picture(scene: Scene, one: Step, other: Step) -> bool:
    """Whether nothing tells these steps of a scene apart, as where light joins before E or is off."""
    return STEP_RULES[one] == STEP_RULES[other] and active_shading(scene, one) == active_shading(scene, other)


def distinct_steps(scene: Scene) -> list[Step]:
    """Those to draw for a person who watches, up to the finest: of steps with the same picture the last."""
    wanted = [step for step in Step if step <= finest_step(scene)]
    alike = {step for step, following in pairwise(wanted) if same_picture(scene, step, following)}
    return [step for step in wanted if step not in alike]


def stands_for(scene: Scene, step: Step) -> Step:
    """Of the steps up to the finest with the picture of this one the last; the step itself if there are none."""
    alike = (one for one in Step if one <= finest_step(scene) and same_picture(scene, one, step))
    return max(alike, default=step)


def drawn_alike(scene: Scene, other: Scene) -> bool:
    """Whether each step has the same picture of both: up to F, however they differ in what step G alone obeys."""
    slabs = STEP_RULES[finest_step(scene)].slabs
    told = (key for key in KEYS.values() if slabs or not key.told.slabs_alone)
    return all(key.place == FINEST or key.of(scene) == key.of(other) for key in told)


def _emits_nothing(scene: Scene) -> bool:
    if scene.plane.patches:
        return scene.plane.dark
    return all(max(colour) == 0.0 for _, colour in scene.tables.emit.points)
