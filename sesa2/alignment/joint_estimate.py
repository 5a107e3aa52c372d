"""Mountings, headings that may change, and the shapes of all frames, estimated together (see `self_calibration`)."""

from typing import NamedTuple

import numpy as np

from sesa2.alignment.heading_filter import DRIFT_STD, DRIFT_TIME
from sesa2.alignment.shape_prior import TWIST, Marginal, ShapePrior, likelier_twist
from sesa2.sensing.imu.mounting import Mounting
from sesa2.shape.layout import Layout
from sesa2.shape.rotations import FloatArray, from_rotation_vector, multiply, rotate

# The prior's widths are learnt from all IMUs together, in which those expected count as much as so many parameters.
_COUNTS_AS = 6

_ITERATIONS = 35
_TWIST_AFTER = (
    8  # iterations: what lasts is to be found as a change of headings before twist is let explain it
)
_SETTLED = np.deg2rad(0.003)

# Windows of a recording in which a heading is constant, s.
_WINDOW = 10.0
_MIN_WINDOWS, _MAX_WINDOWS = 6, 40
_FEWEST_FRAMES = 3  # of a window that tells about twist
_FORGOTTEN = 0.25  # of a short recording, after which a change is forgotten, so that it may come and go
# Wide at first, and narrowed by what is seen: begun narrow, a change would be taken for twist and never be found.
_FIRST_DRIFT = np.deg2rad(10.0)


class HeadingWindows(NamedTuple):
    """Windows of a recording in which a heading is taken as constant.

    Attributes
    ----------
    of_frame : (n,)
        in which each frame is.
    share : (n_windows,)
        of the recording, in sum 1.
    inverse_correlation : (n_windows, n_windows)
        of an Ornstein–Uhlenbeck process at their middles.
    begins : (n_windows,)
        s, from the beginning of the recording.
    """

    of_frame: np.ndarray
    share: FloatArray
    inverse_correlation: FloatArray
    begins: FloatArray

    @classmethod
    def of(cls, stamps: FloatArray, frames: np.ndarray) -> 'HeadingWindows':
        """Cut a recording, of which `frames` are used."""
        start, seconds = stamps.min(), np.ptp(stamps)
        n = int(np.clip(seconds / _WINDOW, _MIN_WINDOWS, _MAX_WINDOWS))
        width = seconds / n
        window = np.minimum(((stamps - start) / width).astype(int), n - 1)
        apart = width * np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
        return cls(
            window[frames],
            np.bincount(window, minlength=n) / len(window),
            np.linalg.inv(np.exp(-apart / min(DRIFT_TIME, _FORGOTTEN * seconds))),
            width * np.arange(n),
        )


class JointEstimate:
    """The joint estimate. With β = (μ, ψ) of an IMU, its link is oriented as q_WL = Rz(−ψ − δ) ⊗ measured ⊗ exp(−μ).

    δ is what the heading changes by while the recording lasts, constant over each window of it, an Ornstein–Uhlenbeck
    process from window to window whose width is learnt for each IMU: a magnetic disturbance that comes or goes would
    else be taken for a twist of the arm, and spoil all that is learnt with it.
    """

    def __init__(
        self,
        layout: Layout,
        links: FloatArray,
        measured: np.ndarray,
        bases: FloatArray,
        windows: HeadingWindows,
        expected: tuple[float, float],
    ):
        n_imu = links.shape[1]
        self._prior = ShapePrior(layout)
        self._links, self._measured, self._bases = links, measured, bases
        self._window, self._share = windows.of_frame, windows.share
        self._unlike = windows.inverse_correlation
        self._rows = 3 * measured.sum(axis=-1)
        self._heard = measured.any(axis=0)
        self._nominal = np.square([expected[0]] * 3 + [expected[1]])
        self._prior_variances = self._nominal
        self._drift_variances = np.full(n_imu, _FIRST_DRIFT**2)
        self.beta = np.zeros((n_imu, 4))
        self.drift = np.zeros((len(self._share), n_imu))
        self._covariance = np.empty(0)
        self.twist = TWIST
        self.misfit = np.inf
        self.weight = 1.0
        self._curvature = self._prior.first_guess(links, bases)

    @property
    def expected(self) -> FloatArray:
        """Errors expected of an IMU that the motion tells nothing of, (4,), rad."""
        return np.sqrt(np.maximum(self._nominal, self._prior_variances))

    @property
    def corrections(self) -> FloatArray:
        """Mountings and, as a mean over the recording, headings; (n_imu, 4), rad."""
        return np.column_stack([self.beta[:, :3], self.beta[:, 3] + self._share @ self.drift])

    @property
    def std(self) -> FloatArray:
        """Standard deviations of the corrections, (n_imu, 4), rad."""
        n_imu = len(self.beta)
        variances = np.diag(self._covariance)[: 4 * n_imu].reshape(n_imu, 4).copy()
        for i in range(n_imu):
            at = np.r_[4 * i + 3, 4 * n_imu + i : len(self._covariance) : n_imu]
            mean = np.r_[1.0, self._share]
            variances[i, 3] = mean @ self._covariance[np.ix_(at, at)] @ mean
        return np.sqrt(variances)

    def solve(self) -> None:
        """Iterate until the corrections stay as they are."""
        for iteration in range(_ITERATIONS):
            step = self._step(learn=iteration > 1, learn_twist=iteration > _TWIST_AFTER)
            if iteration > _TWIST_AFTER + 3 and np.abs(step).max() < _SETTLED:
                break

    def _step(self, learn: bool, learn_twist: bool) -> FloatArray:
        n, n_imu = self._links.shape[:2]
        K = len(self.drift)
        y, J, shape = self._prior.linearise(self._curvature, self._corrected(), self._bases)
        marginal = self._prior.marginalise(J, self._measured, self.twist)
        # d = H β: mountings turn about the link's axes, headings about the world's z.
        H = np.zeros((n, 3 * n_imu, 4 * n_imu))
        each, per_imu = np.arange(n_imu), H.reshape(n, n_imu, 3, n_imu, 4)
        per_imu[:, each, :, each, :3] = rotate(shape[:, :, None], np.eye(3)).transpose(1, 0, 3, 2)
        per_imu[:, each, 2, each, 3] = 1.0
        WH = marginal.precision @ H
        Wy = np.einsum('nrs,ns->nr', marginal.precision, y)
        # A frame that fits worse than those around it, from a damaged sample, is weighted down.
        misfit = np.einsum('nr,nr->n', y, Wy) / self._rows
        self.misfit = float(np.median(misfit))
        usual = np.array([np.median(misfit[self._window == k]) for k in self._window])
        trust = np.minimum(1.0, np.maximum(usual, 1.0) / misfit)
        scaled = self.weight * trust[:, None, None] * WH
        # What each window tells about β tells the same about its δ, which acts as the heading does.
        information, pull = np.zeros((K, 4 * n_imu, 4 * n_imu)), np.zeros((K, 4 * n_imu))
        np.add.at(information, self._window, H.swapaxes(1, 2) @ scaled)
        np.add.at(pull, self._window, np.einsum('nri,nr->ni', scaled, y))
        x = np.concatenate([self.beta.ravel(), self.drift.ravel()])
        precision, gradient = self._with_prior(information, pull, x)
        self._covariance = np.linalg.inv(precision)
        step = self._covariance @ gradient
        x += step
        self.beta, self.drift = x[: 4 * n_imu].reshape(n_imu, 4), x[4 * n_imu :].reshape(K, n_imu)
        # By frame: every heading turns by the step of its δ too.
        steps = np.repeat(step[None, : 4 * n_imu], n, axis=0)
        steps[:, 3::4] += step[4 * n_imu :].reshape(K, n_imu)[self._window]
        weighed = Wy - np.einsum('nri,ni->nr', WH, steps)
        self._curvature = self._prior.most_likely(J, weighed, self.twist)
        if learn_twist:
            self.twist = self._likelier_twist(marginal, np.sqrt(trust)[:, None] * weighed)
        if learn:
            self._prior.widen(self._corrected(), self._bases)
            self._learn_widths()
        return step[: 4 * n_imu]

    def _likelier_twist(self, marginal: Marginal, weighed: FloatArray) -> float:
        """From what changes within a window: what lasts is heading. The median, since headings may jump in one."""
        found = []
        for k in np.unique(self._window):
            own = self._window == k
            n = int(own.sum())
            if n >= _FEWEST_FRAMES:
                changing = np.sqrt(n / (n - 1.0)) * (weighed[own] - weighed[own].mean(axis=0))
                found.append(
                    likelier_twist(self.twist, Marginal(*(part[own] for part in marginal)), changing)
                )
        return float(np.median(found)) if found else self.twist

    def _corrected(self) -> FloatArray:
        """q_WL as known so far, (n, n_imu, 4)."""
        unmounted = Mounting(from_rotation_vector(self.beta[:, :3]), self.beta[:, 3]).link_orientations(
            self._links
        )
        turn = np.zeros((*self.drift.shape, 3))
        turn[..., 2] = -self.drift
        return multiply(from_rotation_vector(turn)[self._window], unmounted)

    def _with_prior(
        self, information: FloatArray, pull: FloatArray, x: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Normal equations of β and δ, window by window."""
        K, n_beta = pull.shape
        n_imu = n_beta // 4
        heading = np.arange(3, n_beta, 4)
        precision = np.zeros((len(x), len(x)))
        precision[:n_beta, :n_beta] = information.sum(axis=0) + np.diag(
            1.0 / np.tile(self._prior_variances, n_imu)
        )
        precision[n_beta:, n_beta:] = np.kron(self._unlike, np.diag(1.0 / self._drift_variances))
        gradient = np.concatenate([pull.sum(axis=0), pull[:, heading].ravel()])
        gradient[:n_beta] -= x[:n_beta] / np.tile(self._prior_variances, n_imu)
        gradient[n_beta:] -= precision[n_beta:, n_beta:] @ x[n_beta:]
        for k in range(K):
            own = slice(n_beta + k * n_imu, n_beta + (k + 1) * n_imu)
            precision[:n_beta, own] = information[k][:, heading]
            precision[own, :n_beta] = information[k][heading]
            precision[own, own] += information[k][np.ix_(heading, heading)]
        return precision, gradient

    def _learn_widths(self) -> None:
        """Expectation step for the prior's widths, over the IMUs that were heard."""
        n_imu = len(self.beta)
        seen = (self.beta**2 + np.diag(self._covariance)[: 4 * n_imu].reshape(-1, 4))[self._heard]
        mounting = (_COUNTS_AS * self._nominal[0] + seen[:, :3].sum()) / (_COUNTS_AS + seen[:, :3].size)
        heading = (_COUNTS_AS * self._nominal[3] + seen[:, 3].sum()) / (_COUNTS_AS + len(seen))
        self._prior_variances = np.array([mounting] * 3 + [heading])
        for i in range(n_imu):
            own = slice(4 * n_imu + i, None, n_imu)
            second = np.outer(self.drift[:, i], self.drift[:, i]) + self._covariance[own, own]
            self._drift_variances[i] = (_COUNTS_AS * DRIFT_STD**2 + np.sum(self._unlike * second)) / (
                _COUNTS_AS + len(self.drift)
            )
