"""Expected error of the shape from magnetometers, by source, before the arm is built; and what a calibration leaves."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from sesa2.configuration import Configuration
from sesa2.errors import Sesa2Error
from sesa2.sensing.magnetometry.build_parameters import USUAL_BUILD, BuildErrors, BuildParameters
from sesa2.shape.models.magnetic import Magnetic
from sesa2.shape.rotations import FloatArray

NOISE, MICROTESLA, BUILD = 'noise', 'per µT', 'build, together'
STRAIGHT, POSES = 'build, calibrated straight', 'build, calibrated in 100 poses'
# Readings of the straight pose that are averaged; poses of motion capture and how well their shapes are known.
_AVERAGED = 50
_POSES = 100
_POSE_BEND, _POSE_LENGTH = 2.3e-3, 0.1e-3  # rad, m
_BUILD_KINDS = {
    'strength': "magnets' strength",
    'shift': "magnets' shift",
    'position': "sensors' position",
    'tilt': "sensors' tilt",
    'gain': 'gain',
    'offset': 'offset',
    'earth': 'earth field ignored',
}


@dataclass(frozen=True)
class MagneticBudget:
    """An error budget of the model `magnetic`.

    Attributes
    ----------
    coordinate_names
        `segment_1_bend`, of both directions together, and so on.
    marker_names, marker_positions
        names and arc lengths, m.
    samples
        number of shapes.
    noise
        of a reading, T.
    build
        sizes of the errors of the build.
    coordinates, markers
        by source: standard deviation of each coordinate, rad and m, and distance at each marker, m; medians of all
        shapes.
    """

    coordinate_names: tuple[str, ...]
    marker_names: tuple[str, ...]
    marker_positions: tuple[float, ...]
    samples: int
    noise: float
    build: BuildErrors
    coordinates: dict[str, FloatArray]
    markers: dict[str, FloatArray]

    def json(self) -> dict[str, Any]:
        """For `--json`: `errors` → source → `coordinates`, `markers`."""
        return {
            'samples': self.samples,
            'noise_T': self.noise,
            'build': asdict(self.build),
            'errors': {
                source: {
                    'coordinates': dict(zip(self.coordinate_names, own.tolist(), strict=True)),
                    'markers_mm': dict(
                        zip(self.marker_names, (1e3 * self.markers[source]).tolist(), strict=True)
                    ),
                }
                for source, own in self.coordinates.items()
            },
        }

    def rows(self) -> tuple[list[str], list[list[str]]]:
        """Head and cells of a table for people."""
        lengths = [name.endswith('length') for name in self.coordinate_names]
        head = ['source']
        for name, length in zip(self.coordinate_names, lengths, strict=True):
            head.append(f'{name.removeprefix("segment_")} [{"mm" if length else "°"}]')
        head += [f'{name} [mm (%)]' for name in self.marker_names]
        cells = []
        for source, own in self.coordinates.items():
            row = [source]
            row += [
                f'{1e3 * v if length else np.rad2deg(v):.2g}' for v, length in zip(own, lengths, strict=True)
            ]
            row += [
                f'{1e3 * v:.1f} ({100.0 * v / s:.2f})'
                for v, s in zip(self.markers[source], self.marker_positions, strict=True)
            ]
            cells.append(row)
        return head, cells


def draw_magnetic_budget(
    configuration: Configuration, build: BuildErrors = USUAL_BUILD, *, samples: int = 500, seed: int = 0
) -> MagneticBudget:
    """Draw up the error budget of shapes from magnetometers.

    Errors are carried from readings to coordinates by the derivatives at each of the shapes, drawn within the limits:
    of a source with covariance C in the readings, K C Kᵀ with K = (JᵀJ/σ² + prior)⁻¹ Jᵀ/σ².

    Parameters
    ----------
    configuration
        with magnets and magnetometers; without markers, the tip.
    build
        how well magnets and magnetometers are where and as they are described.
    samples
        number of shapes, at least 100.
    seed
        of the draws.

    Raises
    ------
    Sesa2Error
        samples are too few, there are no magnetometers, or a marker sits on the base.
    """
    if samples < 100:
        raise Sesa2Error(f'samples = {samples}, expected at least 100')
    if not configuration.magnetometers.ids:
        raise Sesa2Error('magnetometers.ids is empty, expected some: of these the error is')
    names, markers = configuration.markers.names, configuration.markers.positions
    if not markers:
        names, markers = ('tip',), (configuration.arm.length,)
    if min(markers) <= 0.0:
        raise Sesa2Error(
            f'marker {names[int(np.argmin(markers))]} is at 0 m, where there is no error to budget'
        )
    model = configuration.create_model('magnetic')
    assert isinstance(model, Magnetic)
    predictor, limits = model.predictor, model.predictor.limits
    base, rng = configuration.base, np.random.default_rng(seed)
    shapes = limits.draw(samples, rng)
    J = predictor.predict(shapes, base).jacobian
    weighted = np.swapaxes(J, -1, -2) / predictor.noise**2
    K = np.linalg.solve(weighted @ J + np.diag(limits.scales**-2.0), weighted)
    parameters = BuildParameters(predictor, build)
    by_build = parameters.look(np.zeros(len(parameters.names)), shapes, np.broadcast_to(base, (samples, 4)))[
        1
    ]
    moved = K @ by_build

    def of_build(covariance: FloatArray) -> FloatArray:
        return moved @ covariance @ np.swapaxes(moved, -1, -2)

    prior = np.diag(parameters.deviations**2)
    inside = np.arange(len(parameters.names)) < parameters.earth.start
    sources = {NOISE: K * predictor.noise**2 @ np.swapaxes(K, -1, -2)}
    sources[MICROTESLA] = sources[NOISE] * (1e-6**2 / configuration.magnetometers.noise**2)
    for kind, title in _BUILD_KINDS.items():
        of = parameters.kinds[kind]
        if of.start < of.stop:
            own = np.zeros(len(parameters.names))
            own[of] = parameters.deviations[of]
            sources[title] = of_build(np.diag(own**2))
    sources[BUILD] = of_build(prior * np.outer(inside, inside))
    straight = np.broadcast_to(limits.kinematics.rest, (1, len(limits.scales)))
    sources[STRAIGHT] = of_build(_left(parameters, straight, base, 0.0, _AVERAGED, inside))
    poses = limits.draw(_POSES, rng)
    lengths = np.array(['length' in name for name in limits.kinematics.coordinate_names])
    known = np.where(lengths, _POSE_LENGTH, _POSE_BEND)
    sources[POSES] = of_build(_left(parameters, poses, base, known, 1, np.ones_like(inside)))
    rates = limits.kinematics.backbone(shapes).jacobian(np.array(markers))[..., :3, :]
    groups = [
        name.replace('bend_x', 'bend').replace('bend_y', 'bend')
        for name in limits.kinematics.coordinate_names
    ]
    grouped = tuple(dict.fromkeys(groups))
    member = np.array([[name == of for name in groups] for of in grouped], dtype=float)
    member /= member.sum(axis=1, keepdims=True)
    coordinates, distances = {}, {}
    for source, covariance in sources.items():
        variances = np.diagonal(covariance, axis1=-2, axis2=-1)
        coordinates[source] = np.median(np.sqrt(variances @ member.T), axis=0)
        square = np.einsum('nmia,nab,nmib->nm', rates, covariance, rates)
        distances[source] = np.median(np.sqrt(square), axis=0)
    return MagneticBudget(
        grouped,
        tuple(names),
        tuple(markers),
        samples,
        configuration.magnetometers.noise,
        build,
        coordinates,
        distances,
    )


def _left(
    parameters: BuildParameters,
    shapes: FloatArray,
    base: FloatArray,
    known: FloatArray | float,
    averaged: int,
    fitted: np.ndarray,
) -> FloatArray:
    """Covariance of the parameters after a calibration by readings of shapes; those not `fitted` are known."""
    n = len(parameters.names)
    bases = np.broadcast_to(base, (len(shapes), 4))
    by_build = parameters.look(np.zeros(n), shapes, bases)[1]
    p = parameters.predictor
    by_shape = p.predict(shapes, bases).jacobian * known
    weight = 1.0 / np.sqrt(p.noise**2 / averaged + np.sum(by_shape**2, axis=-1))
    rows = (weight[..., None] * by_build).reshape(-1, n)[:, fitted]
    out = np.zeros((n, n))
    information = rows.T @ rows + np.diag(parameters.deviations[fitted] ** -2.0)
    out[np.ix_(fitted, fitted)] = np.linalg.inv(information)
    return out
