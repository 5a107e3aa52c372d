"""Bias, scale and misalignment of an accelerometer from poses in which it was held still (thesis 4.2.5).

The model is m = T s + b: of the true specific force s the sensor says m. Corrected against the thesis: its bias, the
mean over all poses, is right only where these are balanced, so that here bias and T are fitted together; its T of
eq. 4.2 leads from true to measured, so that eq. 4.3 needs the inverse; and it takes exact poses for granted.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sesa2.errors import Sesa2Error
from sesa2.shape.rotations import FloatArray

STANDARD_GRAVITY = 9.80665
SIDES = ('+x', '-x', '+y', '-y', '+z', '-z')
"""The six poses: which axis of the sensor points up."""

# A pose that is off by 0.3° disturbs by this share of gravity; beyond it directions teach less than they spoil.
_EXACT = 0.005
# No accelerometer that works is further off than by these: bias as a share of gravity, and scale.
_PLAUSIBLE_BIAS, _PLAUSIBLE_SCALE = 0.3, 1.25
# What the fit to gravity's size expects, as shares of gravity: of a pose's mean, biases, scales, misalignments.
_NOISE, _BIAS, _SCALE, _MISALIGNMENT = 0.001, 0.1, 0.05, 0.01
_STEPS = 30


class AccelerometerError(Sesa2Error):
    """Poses from which an accelerometer cannot be calibrated, or a calibration that cannot be."""


@dataclass(frozen=True)
class AccelerometerCalibration:
    """What turns the measured acceleration into the true one: matrix · (measured − bias).

    Attributes
    ----------
    bias
        (3,), m/s², in the sensor's axes.
    matrix
        (3, 3): scale and misalignment.
    """

    bias: tuple[float, ...]
    matrix: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        matrix = np.asarray(self.matrix, float)
        if (
            np.shape(self.bias) != (3,)
            or matrix.shape != (3, 3)
            or not np.isfinite([*matrix, self.bias]).all()
        ):
            raise AccelerometerError(
                f'expected 3 and 3 × 3 numbers, got bias {self.bias}, matrix {self.matrix}'
            )
        if np.linalg.det(matrix) <= 0.0:
            raise AccelerometerError(f'matrix {self.matrix} mirrors or flattens what is measured')

    def apply(self, accelerations: ArrayLike) -> FloatArray:
        """True accelerations from measured ones, (..., 3), m/s²."""
        return (np.asarray(accelerations, float) - self.bias) @ np.transpose(self.matrix)


class KeptAccelerometers(NamedTuple):
    """Calibrations by IMU id, and what is missing of them, for people."""

    calibrations: dict[int, AccelerometerCalibration]
    problems: tuple[str, ...] = ()


@dataclass(frozen=True)
class PoseFit:
    """A calibration, and how it came about.

    Attributes
    ----------
    calibration
        what was fitted.
    exact
        whether the poses were found to stand on axes at right angles, so that misalignment is in it as the thesis has
        it; else only gravity's size was used: bias and scale, and of misalignment what further poses tell.
    residual
        root mean square of what is left of |a| − g over the poses, m/s².
    """

    calibration: AccelerometerCalibration
    exact: bool
    residual: float


def calibrate_accelerometer(poses: ArrayLike, gravity: float = STANDARD_GRAVITY) -> PoseFit:
    """Calibrate by still poses that have every side up at least once, however often each.

    Parameters
    ----------
    poses : (n, 3)
        mean of what was measured in each pose, m/s².
    gravity
        at the place, m/s².

    Raises
    ------
    AccelerometerError
        if a side is missing, or the poses make no sense.
    """
    m = np.asarray(poses, float).reshape(-1, 3)
    up = [side_up(pose) for pose in m]
    if missing := [side for side in SIDES if side not in up]:
        raise AccelerometerError(
            f'of the six poses there is none with {", ".join(missing)} up; got {len(m)} still poses'
        )
    directions = np.array([_direction(side) for side in up])
    fitted = fit_to_directions(m, directions, gravity)
    left = fitted.apply(m) - gravity * directions
    exact = bool(np.sqrt(np.mean(left**2)) <= _EXACT * gravity)
    if not exact:
        fitted = fit_to_gravity(m, gravity)
    residual = float(np.sqrt(np.mean((np.linalg.norm(fitted.apply(m), axis=1) - gravity) ** 2)))
    scales = np.linalg.svd(fitted.matrix, compute_uv=False)
    far_off = np.linalg.norm(fitted.bias) > _PLAUSIBLE_BIAS * gravity
    if far_off or not 1 / _PLAUSIBLE_SCALE < scales[-1] <= scales[0] < _PLAUSIBLE_SCALE:
        raise AccelerometerError(
            f'the poses need a bias of {np.linalg.norm(fitted.bias):.2f} m/s² and scales of {scales[-1]:.2f} to '
            f'{scales[0]:.2f}, which no accelerometer has: was it still in each, and does it measure in m/s²?'
        )
    return PoseFit(fitted, exact, residual)


def side_up(pose: ArrayLike) -> str:
    """Which side is up in a pose, one of `SIDES`, from what is measured in it, (3,)."""
    pose = np.asarray(pose, float)
    axis = int(np.argmax(np.abs(pose)))
    return f'{"+" if pose[axis] > 0 else "-"}{"xyz"[axis]}'


def fit_to_directions(
    poses: ArrayLike, directions: ArrayLike, gravity: float = STANDARD_GRAVITY
) -> AccelerometerCalibration:
    """Bias, scale and misalignment by poses that are known (thesis eq. 4.1–4.3, corrected): least squares.

    Parameters
    ----------
    poses : (n, 3)
        mean of what was measured in each pose, m/s²; each counts the same.
    directions : (n, 3)
        unit vectors upwards, in the axes that the result is to have.
    gravity
        m/s².

    Raises
    ------
    AccelerometerError
        if the directions lie in a plane that does not tell bias from scale.
    """
    s = gravity * np.asarray(directions, float)
    design = np.column_stack([s, np.full(len(s), gravity)])
    singular = np.linalg.svd(design, compute_uv=False)
    if len(s) < 4 or singular[-1] < 1e-2 * singular[0]:
        raise AccelerometerError(
            f'{len(s)} poses in directions that do not tell bias from scale, expected the six sides up'
        )
    solution, *_ = np.linalg.lstsq(design, np.asarray(poses, float), rcond=None)
    T, bias = solution[:3].T, gravity * solution[3]
    return _calibration(bias, np.linalg.inv(T))


def fit_to_gravity(poses: ArrayLike, gravity: float = STANDARD_GRAVITY) -> AccelerometerCalibration:
    """Bias, scale and misalignment by poses whose directions are not known, from |matrix · (m − bias)| = g alone.

    Six sides up tell bias and scale, and of misalignment nothing; further, slanting poses tell that too. So the matrix
    is symmetric (a turn as a whole leaves gravity's size) and what is not told stays near none: Gauss–Newton with a
    prior.

    Parameters
    ----------
    poses : (n, 3)
        mean of what was measured in each pose, m/s².
    gravity
        m/s².
    """
    m = np.asarray(poses, float) / gravity
    pairs = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
    x = np.zeros(9)  # bias; then what the symmetric matrix has beyond 1, in the order of the pairs
    weights = 1.0 / np.array([*[_BIAS] * 3, *[_SCALE] * 3, *[_MISALIGNMENT] * 3])
    for _ in range(_STEPS):
        P, u = _symmetric(x[3:], pairs), m - x[:3]
        a = u @ P
        size = np.linalg.norm(a, axis=1)
        n = a / size[:, np.newaxis]
        by_matrix = [n[:, i] * u[:, j] + (n[:, j] * u[:, i] if i != j else 0.0) for i, j in pairs]
        jacobian = np.column_stack([-(n @ P), *by_matrix]) / _NOISE
        rows = np.vstack([jacobian, np.diag(weights)])
        step, *_ = np.linalg.lstsq(rows, np.concatenate([(1.0 - size) / _NOISE, -weights * x]), rcond=None)
        x += step
        if np.abs(step).max() < 1e-12:
            break
    return _calibration(gravity * x[:3], _symmetric(x[3:], pairs))


def _symmetric(beyond: FloatArray, pairs: list[tuple[int, int]]) -> FloatArray:
    P = np.eye(3)
    for value, (i, j) in zip(beyond, pairs, strict=True):
        P[i, j] += value
        P[j, i] = P[i, j]
    return P


def _direction(side: str) -> FloatArray:
    direction = np.zeros(3)
    direction['xyz'.index(side[1])] = 1.0 if side[0] == '+' else -1.0
    return direction


def _calibration(bias: FloatArray, matrix: FloatArray) -> AccelerometerCalibration:
    return AccelerometerCalibration(tuple(bias.tolist()), tuple(map(tuple, matrix.tolist())))
