"""Estimates and truth at common times, and what registrations make of them."""

from collections.abc import Mapping

import numpy as np

from sesa2.evaluation.registration import KINDS, WITH_OFFSETS, Kind, Registration, fit_registration
from sesa2.evaluation.trajectory import EvaluationError, Trajectory
from sesa2.shape.rotations import FloatArray

MAX_COMPARED = 20_000  # samples, of registrations with one another


class Comparison:
    """Estimates and truth at common times.

    Parameters
    ----------
    estimates
        by model, complete.
    truth
        what they are compared with; its times are those in common.
    time_offset
        truth time − estimate time, s.

    Attributes
    ----------
    matched
        estimated positions at the truth's times, (n, m, 3), m, by model; NaN where there is no estimate.
    """

    def __init__(self, estimates: Mapping[str, Trajectory], truth: Trajectory, time_offset: float):
        self._estimates, self._truth, self._times = estimates, truth, truth.times - time_offset
        self.matched = {model: trajectory.at(self._times) for model, trajectory in estimates.items()}

    def fit(self, register: Kind, fitted: np.ndarray) -> tuple[Registration, str]:
        """The registration on these samples, by the model that it suits best, and that model."""
        candidates: list[tuple[float, Registration, str]] = []
        truth = self._truth
        for model, positions in self.matched.items():
            x, y = positions[fitted], truth.positions[fitted]
            known = ~np.isnan(x[..., 0] + y[..., 0])
            when = truth.times[fitted][known.any(axis=1)]
            if not len(when):
                continue
            links = (
                self._estimates[model].turned_at(self._times[fitted]) if register in WITH_OFFSETS else None
            )
            found = fit_registration(register, x, y, (float(when[0]), float(when[-1])), links)
            residual = np.linalg.norm((found.apply(x, links) - y)[known], axis=-1)
            candidates.append((float(np.median(residual)), found, model))
        if not candidates:
            raise EvaluationError(f'registration {register} needs samples to fit, got none')
        _, registration, model = min(candidates, key=lambda c: c[0])
        return registration, model

    def registered(self, registration: Registration, which: np.ndarray) -> dict[str, FloatArray]:
        """All models in the truth's frame, at some samples."""
        out = {}
        for model, positions in self.matched.items():
            links = (
                None if registration.offsets is None else self._estimates[model].turned_at(self._times[which])
            )
            out[model] = registration.apply(positions[which], links)
        return out

    def alternatives(self, fitted: np.ndarray, scored: np.ndarray) -> dict[Kind, float]:
        """Median error on the scored samples of the best model, m, by registration fitted on the fitted ones."""
        some = np.arange(len(fitted)) % -(-len(fitted) // MAX_COMPARED) == 0
        fitted, scored = fitted & some, scored & some
        out: dict[Kind, float] = {}
        for kind in KINDS:
            try:
                registration = Registration() if kind == 'none' else self.fit(kind, fitted)[0]
            except EvaluationError:  # the command would refuse it as well
                continue
            off = [
                np.linalg.norm(p - self._truth.positions[scored], axis=2)
                for p in self.registered(registration, scored).values()
            ]
            medians = [float(np.median(e[known])) for e in off if (known := ~np.isnan(e)).any()]
            if medians:
                out[kind] = min(medians)
        return out
