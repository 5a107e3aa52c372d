"""The twist that segments were measured to have and their shapes have not: how much, and whose it may be."""

from typing import Any

import numpy as np

from sesa2.shape.model import Model
from sesa2.shape.rotations import FloatArray
from sesa2.shape.segment_bend import TWIST_OWNERS

# More than sound sensors leave, rad.
MUCH_TWIST = np.deg2rad(5.0)


class LeftTwist:
    """Gathers what is left over at each sweep of a model."""

    def __init__(self) -> None:
        self._sum = np.zeros(0)
        self._squares = np.zeros(0)
        self._n = 0

    def add(self, twists: FloatArray) -> None:
        """Take those of sweeps, (n, n_segments), rad."""
        if not self._n:
            self._sum = np.zeros(twists.shape[-1])
            self._squares = np.zeros(twists.shape[-1])
        self._sum += twists.sum(axis=0)
        self._squares += np.square(twists).sum(axis=0)
        self._n += len(twists)

    def __bool__(self) -> bool:
        return self._n > 0

    @property
    def rms(self) -> FloatArray:
        """Root mean square of each segment, (n_segments,), rad."""
        return np.asarray(np.sqrt(self._squares / max(self._n, 1)))

    @property
    def mean(self) -> FloatArray:
        """Of each segment, (n_segments,), rad."""
        return np.asarray(self._sum / max(self._n, 1))

    @property
    def is_much(self) -> bool:
        """Whether a segment has more than sound sensors leave."""
        return bool((self.rms > MUCH_TWIST).any())

    def told(self, model: Model[Any]) -> str:
        """How much, in a sentence; where it is much, which other forms the model has."""
        each = ', '.join(
            f'{rms:.1f}° rms (mean {mean:+.1f}°) in segment {k}'
            for k, (rms, mean) in enumerate(
                zip(np.rad2deg(self.rms), np.rad2deg(self.mean), strict=True), start=1
            )
        )
        text = f'twist left over: {each}'
        if not self.is_much:
            return text
        owner = getattr(model, 'twist', '')
        others = ', '.join(name for name in TWIST_OWNERS if name != owner)
        return f'{text}; {model.name}.twist is {owner}, the other forms are {others}: whose is it?'
