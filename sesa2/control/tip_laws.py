"""From the error of the tip to the coordinates that are commanded: a class a law."""

from typing import NamedTuple, Protocol

import numpy as np

from sesa2.control.controller_options import ControllerOptions
from sesa2.control.reach import Reach, damped_inverse
from sesa2.control.tip_reference import LAG_S, TipReference
from sesa2.shape.rotations import FloatArray

_SMOOTHING_S = 0.1


class TipFeedback(NamedTuple):
    """What is known of the arm.

    Attributes
    ----------
    tip : (3,)
        in B, m.
    coordinates : (3 m,)
        bend_x, bend_y, length of each segment by the same estimate, rad and m.
    """

    tip: FloatArray
    coordinates: FloatArray


class TipLaw(Protocol):
    """Where the commanded coordinates go from where they are."""

    def reset(self, command: FloatArray) -> None:
        """Begin from these coordinates, (3 m,)."""

    def advance(self, reference: TipReference, feedback: TipFeedback, dt: float) -> FloatArray:
        """Commanded coordinates after a step of dt seconds, (3 m,)."""

    def settle(self, allowed: FloatArray, sent: FloatArray) -> None:
        """What its limits allow the arm of that, and what was sent after the limit of its speed, both (3 m,)."""


class ResolvedRates:
    """u̇ = J⁺ (v + k (x − x̂)): the Jacobian's damped inverse of the speed wanted and of the error that is left.

    x is the reference as it comes through the arm's lag, so that what has not arrived yet is not made up for. Within
    the dead band the error, smoothed, is left alone.
    """

    def __init__(self, options: ControllerOptions, reach: Reach):
        self._options, self._reach = options, reach

    def reset(self, command: FloatArray) -> None:
        """See TipLaw."""
        self._command, self._error = command, np.zeros(3)

    def advance(self, reference: TipReference, feedback: TipFeedback, dt: float) -> FloatArray:
        """See TipLaw."""
        error = reference.expected - feedback.tip
        self._error = self._error + (1.0 - np.exp(-dt / _SMOOTHING_S)) * (error - self._error)
        if np.linalg.norm(self._error) < self._options.dead_band:
            error = np.zeros(3)
        J = self._reach.tip_jacobian(feedback.coordinates)
        wanted = reference.velocity + self._options.gain * error
        return self._command + dt * damped_inverse(J, self._reach.scale, self._options.damping) @ wanted

    def settle(self, allowed: FloatArray, sent: FloatArray) -> None:  # noqa: ARG002
        """See TipLaw."""
        self._command = sent


class IntegratedInverse:
    """u = q(x) + k ∫ (q(x) − q̂): the inverse of where the tip should be, and the error on the inverse.

    Hughes et al., sec. 3, say no more of their law than that the error is taken between the configuration wanted and
    the one measured. The integral sees x as it comes through the arm's lag: with a target that jumps and without the
    lag it overshoots by a third.
    """

    def __init__(self, options: ControllerOptions, reach: Reach):
        self._options, self._reach = options, reach

    def reset(self, command: FloatArray) -> None:
        """See TipLaw."""
        self._led: FloatArray | None = None
        self._begun, self._integral = command, np.zeros_like(command)

    def advance(self, reference: TipReference, feedback: TipFeedback, dt: float) -> FloatArray:
        """See TipLaw."""
        if self._led is None:
            self._led = self._expected = feedback.coordinates
            self._integral = self._begun - self._led
        led = self._led
        for _ in range(2):  # it follows a point that moves by little
            J = self._reach.tip_jacobian(led)
            led = led + damped_inverse(J, self._reach.scale, 0.1 * self._options.damping) @ (
                reference.position - self._reach.tip(led)
            )
        self._led = led = self._reach.within(led)
        self._expected = self._expected + (1.0 - np.exp(-dt / LAG_S)) * (led - self._expected)
        if np.linalg.norm(reference.expected - feedback.tip) >= self._options.dead_band:
            self._integral = self._integral + self._options.gain * dt * (
                self._expected - feedback.coordinates
            )
        return led + self._integral

    def settle(self, allowed: FloatArray, sent: FloatArray) -> None:  # noqa: ARG002
        """See TipLaw."""
        if self._led is not None:
            self._integral = allowed - self._led


def create_law(options: ControllerOptions, reach: Reach) -> TipLaw:
    """The law that the options name."""
    return ResolvedRates(options, reach) if options.law == 'rates' else IntegratedInverse(options, reach)
