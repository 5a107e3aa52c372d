"""Expected error at each marker from each source, on the user's own arm, before it is built (thesis 5.5 as a tool)."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from sesa2.configuration import Configuration
from sesa2.errors import Sesa2Error
from sesa2.sensing.imu.error_model import SOURCES, Bno055Errors, distort
from sesa2.shape.layout import Layout
from sesa2.shape.measured import Measured
from sesa2.shape.missing import fill_missing
from sesa2.shape.model import Model
from sesa2.shape.models import create_model
from sesa2.shape.rotations import FloatArray, from_rotation_vector, multiply, slerp, tangent

CONFIGURED = 'configured'
EVENLY_SPACED = (2, 4, 8)
# Besides the sensors' sources: links instead of the curve that they stand for; the curve instead of the true shape, of
# which only the orientations at the IMUs are known; and everything at once.
LINKS, SPACING, TOGETHER = 'links', 'IMU spacing', 'together'
_LIMIT_OF_LINKS = {'pcc': 'pcc_exact'}

# Where the hand holds the arm, as a fraction of its length (480 of 660 mm in the thesis), and the phase of the
# curvature between clamp and hand: at π/2 the hand pulls sideways, at 3π/2 it has buckled the arm.
_HAND = (0.60, 0.85)
_PHASE = (0.5 * np.pi, 1.5 * np.pi)
_ELEMENTS = 200
_PROBE = 0.01  # the shape before differs by this much of a further one


class BudgetError(Sesa2Error):
    """A budget that cannot be drawn up."""


@dataclass(frozen=True)
class ModelBudget:
    """Errors of one model with one set of IMUs.

    Attributes
    ----------
    layout
        `configured`, or for example `4 evenly spaced`.
    model
        its name.
    imu_positions
        arc lengths of the IMUs, m.
    errors
        by source (keys of SOURCES, `links` where the model has them, `IMU spacing`, `together`): median distance at
        each marker, (n_markers,), m. Of a sensor's source: how far it alone moves the estimate. Of the others: how far
        the estimate is from the truth, or from that of the curve that the links stand for.
    """

    layout: str
    model: str
    imu_positions: tuple[float, ...]
    errors: dict[str, FloatArray]


@dataclass(frozen=True)
class Budget:
    """An error budget.

    Attributes
    ----------
    marker_names, marker_positions
        where errors are given; arc lengths, m.
    bend
        median over the shapes of the angle by which the arm bends in all, rad.
    speed
        median speed of the farthest marker, m/s.
    samples
        number of shapes.
    sensor
        size of the sensors' errors.
    models
        one entry per layout and model.
    """

    marker_names: tuple[str, ...]
    marker_positions: tuple[float, ...]
    bend: float
    speed: float
    samples: int
    sensor: Bno055Errors
    models: tuple[ModelBudget, ...]

    def json(self) -> dict[str, Any]:
        """For `--json`: `layouts` → layout → model → `errors` → marker → source → `median_mm`, `median_pct`."""
        layouts: dict[str, Any] = {}
        for entry in self.models:
            errors = {
                name: {
                    source: {
                        'median_mm': float(1e3 * error[i]),
                        'median_pct': float(100.0 * error[i] / self.marker_positions[i]),
                    }
                    for source, error in entry.errors.items()
                }
                for i, name in enumerate(self.marker_names)
            }
            layouts.setdefault(entry.layout, {})[entry.model] = {
                'imu_positions_m': list(entry.imu_positions),
                'errors': errors,
            }
        return {
            'bend_deg': float(np.rad2deg(self.bend)),
            'speed_m_s': self.speed,
            'samples': self.samples,
            'sensor': asdict(self.sensor),
            'layouts': layouts,
        }

    def table(self) -> str:
        """For people: the sources with the configured IMUs, then what more or fewer IMUs would give."""
        where = ', '.join(
            f'{name} at {1e3 * s:g} mm'
            for name, s in zip(self.marker_names, self.marker_positions, strict=True)
        )
        head = (
            f'Median error in mm (% of arc length) of {where};\n{self.samples} shapes of an arm that a hand bends by'
            f' {np.rad2deg(self.bend):.0f}° in all and moves at {self.speed:g} m/s.'
        )
        configured = [entry for entry in self.models if entry.layout == CONFIGURED]
        columns = [f'{entry.model} {name}' for entry in configured for name in self.marker_names]
        sources = [
            [source, *(cell for entry in configured for cell in self._cells(entry, source))]
            for source in (*SOURCES, LINKS, SPACING, TOGETHER)
        ]
        layouts = [
            [layout, *(cell for e in self.models if e.layout == layout for cell in self._cells(e, TOGETHER))]
            for layout in dict.fromkeys(entry.layout for entry in self.models)
        ]
        where_spaced = 'Evenly spaced: to the tip; with rigid at the middles of the links.'
        tables = _table(['source', *columns], sources), _table(['IMUs', *columns], layouts)
        return '\n\n'.join([head, *tables, where_spaced])

    def _cells(self, entry: ModelBudget, source: str) -> list[str]:
        """One for each marker."""
        if source not in entry.errors:
            return ['–' for _ in self.marker_names]
        return [
            f'{1e3 * error:.1f} ({100.0 * error / s:.2f})'
            for error, s in zip(entry.errors[source], self.marker_positions, strict=True)
        ]


def draw_budget(
    configuration: Configuration,
    sensor: Bno055Errors | None = None,
    *,
    bend: float = np.deg2rad(140.0),
    speed: float = 0.2,
    samples: int = 2000,
    seed: int = 0,
) -> Budget:
    """Draw up the error budget of a configured arm by simulation.

    Shapes, their velocities and the sensors' errors are drawn at random, independently for each sample, from what they
    are in the long run; so the result is the median over arms and time. The defaults of bend and speed are those of the
    thesis's trial. An arm that stretches errs by that besides, and one with actuated sections by jumps of curvature.

    Parameters
    ----------
    configuration
        the arm, its IMUs (those that are not enabled are interpolated), models and markers; without markers, the tip.
        Its `latency` and `time_alignment` take off what they take off.
    sensor
        size of the errors; default: a BNO055 as it comes. After alignment or calibration give what these left.
    bend
        median angle by which the arm bends in all, rad.
    speed
        median speed of the farthest marker, m/s.
    samples
        number of shapes, at least 100.
    seed
        of the draws.

    Returns
    -------
    The budget, for the configured IMUs and for 2, 4 and 8 evenly spaced.

    Raises
    ------
    BudgetError
        bend, speed or samples make no sense, or a marker sits on the base.
    """
    sensor = sensor if sensor is not None else Bno055Errors()
    for name, value, unit in (('bend', bend, 'rad'), ('speed', speed, 'm/s')):
        if not (np.isfinite(value) and value > 0.0):
            raise BudgetError(f'{name} = {value} {unit}, expected a positive number')
    if samples < 100:
        raise BudgetError(f'samples = {samples}, expected at least 100')
    names, markers = configuration.markers.names, configuration.markers.positions
    if not markers:
        names, markers = ('tip',), (configuration.arm.length,)
    if min(markers) <= 0.0:
        raise BudgetError(
            f'marker {names[int(np.argmin(markers))]} is at 0 m, where there is no error to budget'
        )
    shapes = _Shapes(configuration.base, configuration.arm.length, bend, samples, np.random.default_rng(seed))
    period = shapes.probe_time(max(markers), speed)
    entries = []
    for layout, model, alive in _layouts(configuration):
        case = _Case(configuration, model, alive, shapes, period, np.array(markers), seed)
        entries.append(ModelBudget(layout, model.name, model.layout.imu_positions, case.errors(sensor)))
    return Budget(tuple(names), tuple(markers), bend, speed, samples, sensor, tuple(entries))


class _Shapes:
    """Random shapes of a passive arm that a hand bends, each with the shape that it had a moment before.

    Euler's elastica, linearised: between the clamp and a force at h the curvature is a sine that vanishes at h, in a
    plane and of a size drawn at random; beyond h the arm is straight. There is neither twist nor stretch.
    """

    def __init__(self, base: FloatArray, length: float, bend: float, samples: int, rng: np.random.Generator):
        self.base, self._length = base, length
        curvature, change = _sines(samples, rng), _sines(samples, rng)
        # Angles by which the elements turn; their sum has its median at `bend`.
        scale = bend / np.median(np.linalg.norm(curvature, axis=1).sum(axis=0))
        self._q, self._p = self._integrate(scale * curvature)
        self._q_before, self._p_before = self._integrate(scale * (curvature + _PROBE * change))

    def probe_time(self, s: float, speed: float) -> float:
        """How long ago the shapes before were, s, if the point at arc length s has this median speed."""
        moved = self._interpolate(self._p, np.array([s])) - self._interpolate(self._p_before, np.array([s]))
        return float(np.median(np.linalg.norm(moved, axis=-1))) / speed

    def positions(self, s: FloatArray) -> FloatArray:
        """(samples, len(s), 3), world axes, origin at the base, m."""
        return self._interpolate(self._p, s)

    def orientations(self, s: FloatArray, age: FloatArray) -> FloatArray:
        """(samples, len(s), 4), q_WL; each as old as `age` says, (len(s),), in units of the probe time."""
        x = s / self._length * _ELEMENTS
        i = np.minimum(x.astype(int), _ELEMENTS - 1)
        now = slerp(self._q[:, i], self._q[:, i + 1], x - i)
        before = slerp(self._q_before[:, i], self._q_before[:, i + 1], x - i)
        return slerp(now, before, age)

    def _interpolate(self, nodes: FloatArray, s: FloatArray) -> FloatArray:
        x = s / self._length * _ELEMENTS
        i = np.minimum(x.astype(int), _ELEMENTS - 1)
        return nodes[:, i] + (x - i)[:, None] * (nodes[:, i + 1] - nodes[:, i])

    def _integrate(self, steps: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Orientations and positions of the ends of the elements, each of constant curvature."""
        samples = steps.shape[2]
        q, p = np.empty((samples, _ELEMENTS + 1, 4)), np.zeros((samples, _ELEMENTS + 1, 3))
        q[:, 0] = self.base
        turn = np.zeros((samples, 3))
        for i, step in enumerate(steps):
            turn[:, :2] = 0.5 * step.T
            half = from_rotation_vector(turn)
            middle = multiply(q[:, i], half)
            q[:, i + 1] = multiply(middle, half)
            p[:, i + 1] = p[:, i] + self._length / _ELEMENTS * tangent(middle)
        return q, p


def _sines(samples: int, rng: np.random.Generator) -> FloatArray:
    """Curvatures about x and y of each element, (elements, 2, samples), to some scale."""
    at = (np.arange(_ELEMENTS)[:, None] + 0.5) / _ELEMENTS
    hand = rng.uniform(*_HAND, samples)
    along = np.maximum(0.0, 1.0 - at / hand)
    return np.sin(rng.uniform(*_PHASE, samples) * along)[:, None] * rng.standard_normal((2, samples))


class _Case:
    """One model with one set of IMUs on the shapes."""

    def __init__(
        self,
        configuration: Configuration,
        model: Model[Any],
        alive: np.ndarray,
        shapes: _Shapes,
        probe_time: float,
        markers: FloatArray,
        seed: int,
    ):
        self._model, self._alive, self._shapes = model, alive, shapes
        self._probe_time, self._markers, self._seed = probe_time, markers, seed
        self._links = configuration.links
        self._on_base = configuration.imus.base_id != 0
        self._taken_off = configuration.imus.latency
        self._aligned = configuration.time_alignment == 'interpolate'

    def errors(self, sensor: Bno055Errors) -> dict[str, FloatArray]:
        """As in ModelBudget."""
        truth = self._shapes.positions(self._markers)
        perfect = self._estimate(self._model, sensor.only())
        errors = {
            source: _median_distance(self._estimate(self._model, sensor.only(source)), perfect)
            for source in SOURCES
        }
        curve = perfect
        if self._model.name in _LIMIT_OF_LINKS:
            limit = create_model(_LIMIT_OF_LINKS[self._model.name], self._model.layout, links=self._links)
            curve = self._estimate(limit, sensor.only())
            errors[LINKS] = _median_distance(perfect, curve)
        errors[SPACING] = _median_distance(curve, truth)
        errors[TOGETHER] = _median_distance(self._estimate(self._model, sensor), truth)
        return errors

    def _estimate(self, model: Model[Any], sensor: Bno055Errors) -> FloatArray:
        """Markers from what the sensors say, (samples, n_markers, 3), m; the same draws at every call."""
        rng = np.random.default_rng([self._seed, 1])
        stations = self._model.layout.stations  # the base comes first here, and is read last
        n = len(stations) - 1
        age = np.full(n + 1, sensor.latency)
        if sensor.latency > 0.0:
            age -= self._taken_off
        if not self._aligned:
            read = np.array([n, *range(n)])
            age += sensor.read_interval * (n - (0 if self._on_base else 1) - read)
        true = self._shapes.orientations(stations, age / self._probe_time)
        drawn = rng.standard_normal((true.shape[0], n + 1, 10))
        heading = sensor.heading * drawn[..., 3] + sensor.heading_wander * drawn[..., 4]
        disturbance = sensor.white * drawn[..., 5:8]
        disturbance[..., :2] += sensor.tilt * drawn[..., 8:]
        said = distort(true, sensor.mounting * drawn[..., :3], heading, disturbance, sensor.step)
        base = said[:, 0] if self._on_base else self._shapes.base
        filled = fill_missing(said[:, 1:], np.broadcast_to(self._alive, (len(said), n)), model.layout, base)
        return model.fit(Measured(filled, base, model.layout.rest_lengths)).positions(self._markers)


def _layouts(configuration: Configuration) -> list[tuple[str, Model[Any], np.ndarray]]:
    """Name of the layout, model, and which of its IMUs are alive."""
    arm = configuration.layout.arm
    alive = np.array(configuration.imus.enabled)
    names = [name for name in configuration.models if name != 'magnetic']  # that has a budget of its own
    entries = [(CONFIGURED, configuration.create_model(name), alive) for name in names]
    for n in EVENLY_SPACED:
        for name in names:
            # Rigid links are oriented as their middles (Table I); curves want their IMUs at the sections' ends, the
            # last at the tip.
            rigid = name == 'rigid'
            positions = arm.length * ((np.arange(n) + 0.5) / n if rigid else np.arange(1, n + 1) / n)
            options: dict[str, Any] = {'boundaries': 'midpoint', 'base_link_length': 0.0} if rigid else {}
            if name == 'pcc':
                links = sum(configuration.flat()['pcc.segments'])
                options = {'segments': (max(1, round(links / n)),) * n}
            evenly = configuration.with_options(name, **options)
            model = evenly.create_model(name, Layout(arm, tuple(positions.tolist())))
            entries.append((f'{n} evenly spaced', model, np.ones(n, dtype=bool)))
    return entries


def _median_distance(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.median(np.linalg.norm(a - b, axis=-1), axis=0)


def _table(head: list[str], rows: list[list[str]]) -> str:
    widths = [max(len(row[i]) for row in [head, *rows]) for i in range(len(head))]
    return '\n'.join(
        '  '.join(
            [row[0].ljust(widths[0]), *(cell.rjust(w) for cell, w in zip(row[1:], widths[1:], strict=True))]
        )
        for row in [head, *rows]
    )
