"""The coordinates that explain sensors' readings best: Levenberg–Marquardt, for one instant or a whole batch."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sesa2.shape.reading_predictor import ReadingPredictor
from sesa2.shape.rotations import IDENTITY, FloatArray

# A step that changes the coordinates by less than this part of their standard deviation is the last.
LAST_STEP = 1e-3
# Of the Hessian's diagonal, added to it: from a guess, and where the last instant's shape is at hand.
_COLD, _WARM, _LEAST, _MOST = 1e-3, 1e-6, 1e-12, 1e10
# How much stiffer than the rest a coordinate is that is held at its limit.
_STIFF = 1e6
# Batches are worked through in parts of so many, whose arrays stay in the processor's cache.
_PART = 256


class FittedCoordinates(NamedTuple):
    """What a fit found; `batch` as that of the readings.

    Attributes
    ----------
    coordinates : batch + (n_coordinates,)
        rad and m; NaN where it did not converge.
    information : batch + (n_coordinates, n_coordinates)
        inverse of their covariance, the prior included, in coordinates divided by `limits.scales`.
    residuals : batch + (n_readings,)
        measured less predicted, over the expected error, before the last step; 0 where nothing was measured.
    converged : batch
        whether a minimum was found.
    iterations : batch
        steps that were tried.
    """

    coordinates: FloatArray
    information: FloatArray
    residuals: FloatArray
    converged: np.ndarray
    iterations: np.ndarray

    def covariance(self, scales: FloatArray) -> FloatArray:
        """Of the coordinates, batch + (n_coordinates, n_coordinates), rad and m; NaN where it did not converge."""
        information = np.where(self.converged[..., None, None], self.information, np.eye(len(scales)))
        covariance: FloatArray = np.linalg.inv(information) * np.multiply.outer(scales, scales)
        covariance[~self.converged] = np.nan
        return covariance


class CoordinateFit:
    """Fits coordinates: the sum of squares of (measured − predicted) / noise and of (coordinates − rest) / scale.

    The prior says no more than that the arm is within its limits; it keeps the answer where sensors do not tell.
    Readings that are not finite are left out. Trials are clipped to the limits.

    Parameters
    ----------
    predictor
        of the readings.
    most_iterations
        after which there is no convergence.
    """

    def __init__(self, predictor: ReadingPredictor, most_iterations: int = 60):
        self.predictor = predictor
        self.limits = predictor.limits
        self.most_iterations = most_iterations
        self._rest = self.limits.kinematics.rest / self.limits.scales

    def fit(
        self, readings: ArrayLike, start: ArrayLike | None = None, base: ArrayLike = IDENTITY
    ) -> FittedCoordinates:
        """Fit.

        Parameters
        ----------
        readings : batch + (n_readings,)
            as measured; not finite where nothing was.
        start : (n_coordinates,)
            or batch + (n_coordinates,): where to begin, the shape of an instant before; None: the straight arm.
        base : (4,)
            or batch + (4,), q_WB, x y z w.
        """
        readings = np.asarray(readings, dtype=float)
        batch, n = readings.shape[:-1], len(self.limits.scales)
        flat = readings.reshape(-1, readings.shape[-1])
        first = np.broadcast_to(self.limits.kinematics.rest if start is None else start, (*batch, n))
        first = self.limits.clip(first.reshape(-1, n))
        bases = np.asarray(base, dtype=float)
        if bases.ndim > 1:
            bases = np.broadcast_to(bases, (*batch, 4)).reshape(-1, 4)
        damping = _COLD if start is None else _WARM

        def base_of(part: slice) -> FloatArray:
            return bases if bases.ndim == 1 else bases[part]

        slices = [slice(i, i + _PART) for i in range(0, max(len(flat), 1), _PART)]
        parts = [self._fit(flat[part], first[part], base_of(part), damping) for part in slices]
        whole = parts[0] if len(parts) == 1 else [np.concatenate(of) for of in zip(*parts, strict=True)]
        return FittedCoordinates(*(each.reshape((*batch, *each.shape[1:])) for each in whole))

    def _fit(self, u: FloatArray, q: FloatArray, base: FloatArray, damping: float) -> FittedCoordinates:
        n, scales = len(u), self.limits.scales
        out = FittedCoordinates(
            coordinates=np.full(q.shape, np.nan),
            information=np.zeros((n, q.shape[1], q.shape[1])),
            residuals=np.zeros(u.shape),
            converged=np.zeros(n, dtype=bool),
            iterations=np.zeros(n, dtype=int),
        )
        weight = np.isfinite(u) / self.predictor.noise
        u = np.where(weight > 0.0, u, 0.0)
        which = np.arange(n)
        at = self._look(q, u, weight, base)
        lam = np.full(n, damping)
        diagonal = np.arange(q.shape[1])
        for iteration in range(1, self.most_iterations + 1):
            residuals, J, cost = at
            A = np.swapaxes(J, -1, -2) @ J
            A[:, diagonal, diagonal] += 1.0
            pull = (np.swapaxes(J, -1, -2) @ residuals[..., None])[..., 0] + (self._rest - q / scales)
            damped = A.copy()
            damped[:, diagonal, diagonal] *= 1.0 + lam[:, None]
            outward = self.limits.outward(q)
            if outward is not None:
                self._keep_inside(damped, pull, outward)
            trial = self.limits.clip(q + np.linalg.solve(damped, pull[..., None])[..., 0] * scales)
            step = (trial - q) / scales
            small = np.einsum('ni,nij,nj->n', step, A, step) < LAST_STEP**2
            done = small & (lam <= 1.0)
            if done.any():
                end = which[done]
                out.coordinates[end], out.information[end] = trial[done], A[done]
                out.residuals[end], out.converged[end] = residuals[done], True
            over = done | (lam > _MOST)
            out.iterations[which] = iteration
            if over.any():
                on = ~over
                if not on.any():
                    break
                which, q, trial, u, weight, lam = (each[on] for each in (which, q, trial, u, weight, lam))
                at = (residuals[on], J[on], cost[on])
                base = base if base.ndim == 1 else base[on]
            there = self._look(trial, u, weight, base)
            better = there[2] <= at[2]
            if better.all():
                at, q = there, trial
            else:
                at = tuple(  # type: ignore[assignment]
                    np.where(better.reshape(-1, *[1] * (new.ndim - 1)), new, old)
                    for new, old in zip(there, at, strict=True)
                )
                q = np.where(better[:, None], trial, q)
            lam = np.where(better, np.maximum(0.1 * lam, _LEAST), 10.0 * np.maximum(lam, _COLD))
        return out

    @staticmethod
    def _keep_inside(damped: FloatArray, pull: FloatArray, outward: FloatArray) -> None:
        """Have the step go along the limits that the pull would leave, and not against them."""
        out = np.einsum('nlc,nc->nl', outward, pull)
        held = outward * (out > 0.0)[..., None]
        pull -= np.einsum('nlc,nl->nc', held, out)
        stiff = _STIFF * np.trace(damped, axis1=-2, axis2=-1)
        damped += stiff[:, None, None] * (np.swapaxes(held, -1, -2) @ held)

    def _look(
        self, q: FloatArray, u: FloatArray, weight: FloatArray, base: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Residuals over noise, their derivatives by scaled coordinates, and the cost."""
        scales = self.limits.scales
        readings, J = self.predictor.predict(q, base)
        residuals = (u - readings) * weight
        off = self._rest - q / scales
        cost = np.einsum('ni,ni->n', residuals, residuals) + np.einsum('ni,ni->n', off, off)
        return residuals, J * weight[..., None] * scales, cost
