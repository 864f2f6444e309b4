"""What the drawing loop gives to the tabs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from PIL import Image as PillowImage

from volsplat.client.session.published_image import PublishedImage
from volsplat.client.session.renderer import StepOutcome
from volsplat.client.ui.viewing.picture_encoding import encoded
from volsplat.client.ui.viewing.scene_model import SceneState
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.rules.refinement import finest_step
from volsplat.protocol.rules.regions import Rectangle


@dataclass(frozen=True)
class Picture:
    """One image for the page, and what is to be told with it."""

    number: int  # rises with every picture; an older one never follows a newer one
    state: SceneState  # what it shows
    step: Step
    published: PublishedImage  # smaller than the scene's image if it was drawn while things moved
    outcome: StepOutcome | None  # None while the step is still being drawn
    undrawn: tuple[Rectangle, ...] = ()  # see Refinement
    one_in: int = 1  # of so many of the step's voxels one was drawn, while things moved

    @property
    def complete(self) -> bool:
        return self.outcome is not None

    @cached_property
    def data(self) -> bytes:
        """The image over the background: as PNG if it is the last, else as JPEG. Takes a while when first asked for."""
        background = self.state.scene.image.background
        enlarged = self.published.width < self.state.scene.image.width
        return encoded(self.published, background, lossless=self.last, enlarged=enlarged)

    @property
    def in_full_size(self) -> bool:
        """Whether the image is as large as the scene's."""
        image = self.state.scene.image
        return (self.published.width, self.published.height) == (image.width, image.height)

    @property
    def whole(self) -> bool:
        """Whether it is all that its step draws."""
        return self.in_full_size and self.one_in == 1

    @cached_property
    def published_in_full_size(self) -> PublishedImage:
        """The image as the page shows it: scaled up, between its pixels in straight lines."""
        if self.in_full_size:
            return self.published
        image = self.state.scene.image
        channels = np.moveaxis(self.published.pixels, 2, 0)
        larger = [
            PillowImage.fromarray(channel).resize((image.width, image.height), PillowImage.Resampling.BILINEAR)
            for channel in channels
        ]
        return PublishedImage.of(np.stack([np.asarray(channel) for channel in larger], axis=2))

    @property
    def last(self) -> bool:
        """Nothing finer will follow for this scene."""
        return self.complete and self.state.settled and self.step == finest_step(self.state.scene)
