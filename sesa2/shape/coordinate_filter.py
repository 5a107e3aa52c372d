"""Coordinates over time: a Kalman filter that is iterated, and that finds sensors that lie by its predictions."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sesa2.shape.coordinate_fit import CoordinateFit
from sesa2.shape.reading_faults import KNOWN, REPEATS, ReadingFault, ReadingWatch, beyond_chance, find_jumping
from sesa2.shape.reading_predictor import ReadingPredictor
from sesa2.shape.rotations import IDENTITY, FloatArray

MOTIONS = ('random_walk', 'constant_velocity')

# How long an acceleration (or a velocity, of a random walk) lasts, s.
_LASTS = 0.1
# Speed that is expected at the start, scales per second.
_SPEED = 2.0
# After a pause of so many seconds nothing is known any more.
_PAUSE = 1.0
_ITERATIONS = 4
# A velocity is forgotten within some s, so that what no sensor tells does not run off.
_SLOWS = 1.0
# A sensor that jumped is kept out for as many instants as it did, at most so many.
_LONGEST = 20
# Beyond this standard deviation of a coordinate, in its limits, nothing tells it.
_LOST = 0.2
_SMALL_STEP = 0.05  # standard deviations: what is left is of second order


class FilteredShape(NamedTuple):
    """What is known at one instant.

    Attributes
    ----------
    coordinates : (n_coordinates,)
        rad and m; NaN where there is no answer.
    covariance : (n_coordinates, n_coordinates)
        of them.
    faults : (n_sensors,)
        of ReadingFault.
    information : (n_coordinates, n_coordinates)
        what this instant's readings alone tell, in coordinates over their scales, with the identity of the prior.
    doubtful
        whether readings contradict each other and no choice of few sensors explains it.
    """

    coordinates: FloatArray
    covariance: FloatArray
    faults: np.ndarray
    information: FloatArray
    doubtful: bool


class CoordinateFilter:
    """Follows coordinates through instants that come in their order.

    The prediction of an instant is compared with its readings first: a sensor that does not agree while the others do
    is left out. Where no few sensors explain the difference, the arm has moved as nobody expected, and it begins anew
    from this instant's readings alone.

    Parameters
    ----------
    predictor
        of the readings.
    motion
        one of MOTIONS.
    agility
        how abruptly the arm moves: accelerations (random walk: velocities) that last 0.1 s, in limits of a coordinate
        per s² (per s).
    """

    def __init__(self, predictor: ReadingPredictor, motion: str = 'constant_velocity', agility: float = 5.0):
        self.predictor, self.limits = predictor, predictor.limits
        self._with_velocity = motion == 'constant_velocity'
        self._density = 2.0 * _LASTS * agility**2
        self._fit = CoordinateFit(predictor)
        self._watch = ReadingWatch(predictor)
        self._n_sensors = len(predictor.names)
        self._most = max(1, self._n_sensors // 3)
        n = len(self.limits.scales)
        self._x, self._v = np.zeros(n), np.zeros(n)
        self._P = np.eye(2 * n if self._with_velocity else n)
        self.forget()

    def forget(self) -> None:
        """Begin anew."""
        self._watch.forget()
        self._sentence = np.zeros(self._n_sensors, dtype=int)
        self._repeating = np.zeros(self._n_sensors, dtype=bool)
        self._time: float | None = None

    def step(self, time: float, readings: ArrayLike, base: ArrayLike = IDENTITY) -> FilteredShape:
        """Take the readings of an instant.

        Parameters
        ----------
        time
            s.
        readings : (n_readings,)
            not finite where nothing was measured.
        base : (4,)
            q_WB, x y z w.
        """
        readings = np.array(readings, dtype=float)
        faults = self._watch.faults(readings)
        readings[(faults != ReadingFault.NONE)[self.predictor.sensor_of]] = np.nan
        if self._time is None or not 0.0 <= time - self._time <= _PAUSE:
            return self._begin(time, readings, faults, base)
        mean, P = self._predicted(time - self._time)
        there = np.isfinite(readings)
        first = self._look(mean, readings, base)
        found = self._jumping(first, mean, mean, P, there)
        at: tuple[FloatArray, tuple[FloatArray, FloatArray]] = mean, first
        if found is None or found.any():
            # Far from the prediction its derivatives mislead: those at what the other sensors say decide.
            others = (
                there if found is None else there & (found == ReadingFault.NONE)[self.predictor.sensor_of]
            )
            x, *_ = self._explained(mean, P, readings, others, base, (mean, first))
            at = x, self._look(x, readings, base)
            found = self._jumping(at[1], x, mean, P, there)
        if found is None:
            return self._begin(time, readings, faults, base)
        faults = np.where(faults == ReadingFault.NONE, found, faults)
        self._quarantine(faults, first[1], P)
        there &= (faults == ReadingFault.NONE)[self.predictor.sensor_of]
        return self._updated(time, mean, P, readings, there, faults, base, at)

    def _look(self, x: FloatArray, readings: FloatArray, base: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Measured less predicted, and the prediction's derivatives by scaled coordinates, both over the noise."""
        prediction = self.predictor.predict(x * self.limits.scales, base)
        noise = self.predictor.noise
        return (readings - prediction.readings) / noise, prediction.jacobian * self.limits.scales / noise[
            :, None
        ]

    def _predicted(self, dt: float) -> tuple[FloatArray, FloatArray]:
        """Scaled coordinates, and the covariance of these and, if there are any, of velocities."""
        n, q = len(self.limits.scales), self._density
        own = np.arange(n)
        x, P = self._x, self._P.copy()
        if self._with_velocity:
            x = x + dt * self._v
            self._v = self._v * np.exp(-dt / _SLOWS)
            F = np.eye(2 * n)
            F[own, own + n] = dt
            F[own + n, own + n] = np.exp(-dt / _SLOWS)
            P = F @ P @ F.T
            P[own, own] += q * dt**3 / 3.0
            P[own, own + n] += q * dt**2 / 2.0
            P[own + n, own] += q * dt**2 / 2.0
            P[own + n, own + n] += q * dt
        else:
            P[own, own] += q * dt
        wide = np.ones(len(P))
        wide[:n] = 1.0 / np.sqrt(
            np.maximum(P[own, own], 1.0)
        )  # no less is known than that the arm is in its limits
        return self.limits.clip(x * self.limits.scales) / self.limits.scales, P * np.multiply.outer(
            wide, wide
        )

    def _jumping(
        self,
        look: tuple[FloatArray, FloatArray],
        x: FloatArray,
        mean: FloatArray,
        P: FloatArray,
        there: np.ndarray,
    ) -> np.ndarray | None:
        """Per sensor, of ReadingFault, by the innovations that derivatives at x give; None: it is none of them."""
        faults = np.full(self._n_sensors, ReadingFault.NONE)
        n, own = len(x), self.predictor.sensor_of[there]
        lost = P.diagonal()[:n].max() > _LOST**2
        if not there.any() or (
            lost and self.limits.outward(np.stack([x, mean]) * self.limits.scales) is not None
        ):
            return faults  # what nothing tells has run to its limit: what is predicted there accuses nobody
        J = look[1][there]
        S = J @ P[:n, :n] @ J.T + np.eye(len(J))
        found = find_jumping(look[0][there] + J @ (x - mean), S, own, self._most)
        if found is None:
            return None
        faults[np.unique(own)] = found
        return faults

    def _quarantine(self, faults: np.ndarray, J: FloatArray, P: FloatArray) -> None:
        """Keep sensors out that jumped until they agree again, as often as they did not, where their reading is known.

        Without it nobody may know: then what it says is in keeping with everything, right or wrong.
        """
        jumped = faults == ReadingFault.JUMPING
        repeating = faults == ReadingFault.REPEATING
        if (repeating & ~self._repeating).any():
            # While it was not known to be dead, others were accused in its stead.
            self._sentence[self._sentence <= REPEATS] = 0
        self._repeating = repeating
        self._sentence = np.where(jumped, np.minimum(self._sentence + 1, _LONGEST), self._sentence)
        held = (self._sentence > 0) & (faults == ReadingFault.NONE)
        if not held.any():
            return
        n, good = len(self.limits.scales), faults == ReadingFault.NONE
        known = np.zeros(self._n_sensors, dtype=bool)
        for sensor in np.flatnonzero(held):
            own = self.predictor.sensor_of == sensor
            rows = own | (good & ~held)[self.predictor.sensor_of]
            inverse = np.linalg.inv(J[rows] @ P[:n, :n] @ J[rows].T + np.eye(np.count_nonzero(rows)))
            known[sensor] = np.diag(inverse)[own[rows]].min() > KNOWN**-2
        faults[held] = np.where(known[held], ReadingFault.JUMPING, ReadingFault.DOUBTED)
        self._sentence[held & known] -= 1

    def _explained(
        self,
        mean: FloatArray,
        P: FloatArray,
        readings: FloatArray,
        there: np.ndarray,
        base: ArrayLike,
        at: tuple[FloatArray, tuple[FloatArray, FloatArray]],
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """The scaled coordinates that explain readings and prediction best, what both and what readings tell, and the
        prediction's own information.
        """
        n, scales = len(mean), self.limits.scales
        prior = np.linalg.inv(P[:n, :n])
        x, (residuals, J) = at
        for iteration in range(_ITERATIONS):
            if iteration:
                residuals, J = self._look(x, readings, base)
            told = J[there].T @ J[there]
            A = told + prior
            step = np.linalg.solve(A, J[there].T @ residuals[there] + prior @ (mean - x))
            x = self.limits.clip((x + step) * scales) / scales
            if step @ A @ step < _SMALL_STEP**2:
                break
        return x, A, told, prior

    def _updated(
        self,
        time: float,
        mean: FloatArray,
        P: FloatArray,
        readings: FloatArray,
        there: np.ndarray,
        faults: np.ndarray,
        base: ArrayLike,
        at: tuple[FloatArray, tuple[FloatArray, FloatArray]],
    ) -> FilteredShape:
        scales, n = self.limits.scales, len(mean)
        x, A, told, prior = self._explained(mean, P, readings, there, base, at)
        covariance = np.linalg.inv(A)
        if self._with_velocity:
            gain = P[n:, :n] @ prior
            self._v = self._v + gain @ (x - mean)
            across = gain @ covariance
            rest = P[n:, n:] - gain @ P[:n, n:] + across @ gain.T
            covariance = np.block([[covariance, across.T], [across, rest]])
        self._time, self._x, self._P = time, x, 0.5 * (covariance + covariance.T)
        outer = np.multiply.outer(scales, scales)
        return FilteredShape(x * scales, self._P[:n, :n] * outer, faults, told + np.eye(n), False)

    def _begin(self, time: float, readings: FloatArray, faults: np.ndarray, base: ArrayLike) -> FilteredShape:
        """From this instant alone; a sensor is left out if the others then agree, and no other does as well."""
        scales, n = self.limits.scales, len(self.limits.scales)
        held = (self._sentence > 0) & (faults == ReadingFault.NONE)
        if held.any():  # nothing says that what they read is right now
            faults[held] = ReadingFault.DOUBTED
            readings[held[self.predictor.sensor_of]] = np.nan
        start = None if self._time is None else self._x * scales
        every = np.flatnonzero(faults == ReadingFault.NONE)
        # All of them in one batch: with everything, then without each sensor in turn.
        tries = np.tile(readings, (len(every) + 1, 1))
        for i, sensor in enumerate(every):
            tries[i + 1, self.predictor.sensor_of == sensor] = np.nan
        fitted = self._fit.fit(tries[:1], start, base)
        doubtful, best = not self._agrees(fitted.residuals[0], tries[0]), 0
        if doubtful:
            fitted = self._fit.fit(tries, start, base)
            agree = [
                i
                for i in range(1, len(tries))
                if fitted.converged[i] and self._agrees(fitted.residuals[i], tries[i])
            ]
            if len(agree) == 1:
                best, doubtful = agree[0], False
                faults[every[best - 1]] = ReadingFault.JUMPING
            else:
                faults[every[[i - 1 for i in agree]]] = ReadingFault.DOUBTED
        information = fitted.information[best]
        if not fitted.converged[best] or not np.isfinite(tries[best]).any():
            self._time = None
            nothing = np.full((n, n), np.nan)
            return FilteredShape(nothing[0], nothing, faults, np.eye(n), doubtful)
        covariance = np.linalg.inv(information)
        self._time, self._x, self._v = time, fitted.coordinates[best] / scales, np.zeros(n)
        self._P = covariance
        if self._with_velocity:
            self._P = np.zeros((2 * n, 2 * n))
            self._P[:n, :n], self._P[n:, n:] = covariance, _SPEED**2 * np.eye(n)
        return FilteredShape(
            fitted.coordinates[best],
            covariance * np.multiply.outer(scales, scales),
            faults,
            information,
            doubtful,
        )

    def _agrees(self, residuals: FloatArray, readings: FloatArray) -> bool:
        """Whether residuals are what noise leaves; with no more readings than coordinates they always are."""
        spare = int(np.count_nonzero(np.isfinite(readings))) - len(self.limits.scales)
        return spare <= 0 or bool(residuals @ residuals < beyond_chance(spare))
