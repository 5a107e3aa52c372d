"""What BNO055s get wrong, step by step: the error model for a simulation that does not know what comes."""

import numpy as np

from sesa2.sensing.imu.error_model import Bno055Errors, distort
from sesa2.shape.rotations import FloatArray


class ErrorProcess:
    """The errors of several IMUs, which go with time as in `error_model.measure`; latency is the caller's.

    Parameters
    ----------
    errors
        how large they are.
    n_imu
        number of IMUs.
    rng
        source of chance.

    Attributes
    ----------
    mountings : (n_imu, 3)
        μ, rotation vectors in the link's frame, rad.
    headings : (n_imu,)
        ψ, rad.
    tilts : (n_imu, 2)
        about the world's x and y, rad.
    """

    def __init__(self, errors: Bno055Errors, n_imu: int, rng: np.random.Generator):
        self._errors, self._rng = errors, rng
        self.mountings = errors.mounting * rng.standard_normal((n_imu, 3))
        self._constant = errors.heading * rng.standard_normal(n_imu)
        # Unit processes: wander of the heading, and tilt about two axes.
        self._state = rng.standard_normal((n_imu, 3))
        self._times = np.array([errors.heading_time, errors.tilt_time, errors.tilt_time])

    @property
    def headings(self) -> FloatArray:  # noqa: D102
        return self._constant + self._errors.heading_wander * self._state[:, 0]

    @property
    def tilts(self) -> FloatArray:  # noqa: D102
        return self._errors.tilt * self._state[:, 1:]

    def advance(self, dt: float) -> None:
        """Let time pass, s."""
        keep = np.exp(-dt / self._times)
        self._state = keep * self._state + np.sqrt(1.0 - keep * keep) * self._rng.standard_normal(
            self._state.shape
        )

    def measured(self, links: FloatArray) -> FloatArray:
        """What the sensors say at these orientations of their links, with fresh noise.

        Parameters
        ----------
        links : batch + (n_imu, 4)
            true q_WL, x y z w.

        Returns
        -------
        batch + (n_imu, 4), x y z w, as sensors would say that are mounted along their links.
        """
        disturbance = self._errors.white * self._rng.standard_normal((*links.shape[:-1], 3))
        disturbance[..., :2] += self.tilts
        headings = np.broadcast_to(self.headings, links.shape[:-1])
        return distort(links, self.mountings, headings, disturbance, self._errors.step)
