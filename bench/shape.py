"""The estimator's own work for a sweep: against the predecessor's way, scipy and a loop in C, in one run."""

import time
import timeit

import numpy as np
from pcc_loop import pcc_loop
from predecessor import on_sweep
from scipy.spatial.transform import Rotation, Slerp

from sesa2.configuration import validate
from sesa2.estimation.estimator import Estimator
from sesa2.estimation.sweeps import Sweep
from sesa2.shape.arm import Arm
from sesa2.shape.layout import Layout
from sesa2.shape.measured import Measured
from sesa2.shape.models import create_model
from sesa2.shape.rotations import IDENTITY, from_rotation_vector, multiply

POSITIONS = [0.08, 0.16, 0.24, 0.32, 0.40, 0.48, 0.56, 0.64]


def configuration(*models):
    """The arm of the paper with 64 links between its IMUs."""
    return validate(
        {
            'arm': {'length': 0.66},
            'imus': {'ids': list(range(1, 9)), 'positions': POSITIONS},
            'markers': {'names': ['M1', 'M2'], 'positions': [0.36, 0.60]},
            'models': list(models),
            'pcc': {'segments': [8] * 8},
        }
    )


def bent_sweeps(n, rng):
    """Sweeps of an arm that bends by about 30° per section."""
    q = np.empty((n, 8, 4))
    last = np.tile(IDENTITY, (n, 1))
    for i in range(8):
        last = multiply(last, from_rotation_vector(0.3 * rng.normal(size=(n, 3))))
        q[:, i] = last
    return [Sweep(k, q[k], np.ones(8, bool), None) for k in range(n)]


def seconds(function, number, repeat=5):
    """Processor time per call, best of some: what else the machine does then takes from its caches only."""
    return min(timeit.repeat(function, number=number, repeat=repeat, timer=time.process_time)) / number


def in_turn(function, peer, number, rounds=20, peer_number=None):
    """Best of each, per call, taken in turn."""
    numbers = number, peer_number or number
    turns = [
        [seconds(f, n, 3) for f, n in zip((function, peer), numbers, strict=True)] for _ in range(rounds)
    ]
    return (min(of) for of in zip(*turns, strict=True))


def scipy_chain(q, base):
    """Link orientations, positions and joint angles of one model with scipy's Slerp and Rotation."""
    slerp = Slerp([0.0, *POSITIONS], Rotation.from_quat(np.vstack([base, q])))
    links = slerp((np.arange(64) + 0.5) * 0.01)
    positions = np.cumsum(0.01 * links.apply([0.0, 0.0, 1.0]), axis=0)
    before = Rotation.concatenate([Rotation.from_quat(base), links[:-1]])
    return positions, (before.inv() * links).as_euler('XZY')


def rows():
    """(figure, ours, peer's name, peer's, target of the ratio)."""
    rng = np.random.default_rng(1)
    one, many = bent_sweeps(1, rng), bent_sweeps(2000, rng)
    q = one[0].orientations
    both = Estimator(configuration('rigid', 'pcc'))
    ours, theirs = in_turn(
        lambda: both.estimate(one),
        lambda: on_sweep(q, IDENTITY, IDENTITY, [8] * 8, 0.08, np.full(8, 0.0825)),
        20,
        rounds=40,
        peer_number=1,
    )
    yield 'one sweep, rigid + pcc of 64 links', ours, "the predecessor's way", theirs, 100
    pcc = Estimator(configuration('pcc'))
    yield (
        'one sweep, pcc of 64 links',
        seconds(lambda: pcc.estimate(one), 200),
        'scipy',
        seconds(lambda: scipy_chain(q, IDENTITY), 100),
        1,
    )
    spline = Estimator(configuration('spline'))
    ours, theirs = in_turn(lambda: spline.estimate(one), lambda: pcc.estimate(one), 100)
    yield 'one sweep, spline of 64 links', ours, 'pcc', theirs, 0.8
    models = [e.models[name] for e, name in ((spline, 'spline'), (pcc, 'pcc'))]
    ours, theirs = in_turn(*(lambda m=m: m.fit(Measured(q)).positions(m.link_ends) for m in models), 100)
    yield 'one sweep, positions alone, spline', ours, 'pcc', theirs, 1
    for name in ('rigid', 'pcc'):
        model = Estimator(configuration(name))
        each = seconds(lambda m=model: m.estimate(many), 1) / len(many)
        yield f'batched, per sweep, {name}', each, 'target', 25e-6, 1
    ours, theirs = in_turn(lambda: spline.estimate(many), lambda: pcc.estimate(many), 1)
    yield 'batched, per sweep, spline', ours / len(many), 'pcc', theirs / len(many), 1

    measured, scipys = bent_segments(20_000, rng)
    delta = create_model(
        'pcc_delta', Layout(Arm(0.48), (0.16, 0.32, 0.48), (0.16, 0.16, 0.16), stretches=True)
    )
    ours, theirs = in_turn(lambda: delta.fit(measured).coordinates, lambda: scipy_bends(*scipys), 1, rounds=5)
    yield 'batched, per segment, coordinates of pcc_delta', ours / 60_000, 'scipy', theirs / 60_000, 1


def bent_segments(n, rng):
    """What is measured of three segments: as our model takes it, and as base and tip of each for scipy."""
    ends = [Rotation.identity(n)]
    for _ in range(3):
        ends.append(ends[-1] * Rotation.from_rotvec(rng.normal(size=(n, 3)) * [0.5, 0.5, 0.1]))
    q = np.stack([r.as_quat() for r in ends], axis=1)
    lengths = rng.uniform(0.13, 0.2, (n, 3))
    return Measured(q[:, 1:], q[0, 0], lengths=lengths), (q[:, :-1], q[:, 1:])


def scipy_bends(before, after):
    """Relative rotations by scipy, and Hughes et al. eq. 3 from their quaternions."""
    relative = Rotation.from_quat(before.reshape(-1, 4)).inv() * Rotation.from_quat(after.reshape(-1, 4))
    x, y, _, w = relative.as_quat(canonical=True).T
    n = np.hypot(x, y)
    turn = np.where(n > 0.0, 2.0 * np.arctan2(n, w) / np.where(n > 0.0, n, 1.0), 2.0)
    return np.stack([turn * y, -turn * x], axis=-1)


def batched_positions(n=2000):
    """Seconds a sweep of the positions of pcc at the ends of its 65 links, fit included, and of the loop in C."""
    model = Estimator(configuration('pcc')).models['pcc']
    measured = Measured(np.array([sweep.orientations for sweep in bent_sweeps(n, np.random.default_rng(1))]))
    loop, stations = pcc_loop(), measured.stations

    def ours():
        return model.fit(measured).positions(model.link_ends)

    def theirs():
        return loop(stations, 8, 0.01, 0.02)

    np.testing.assert_allclose(ours(), theirs(), atol=1e-12)
    return (each / n for each in in_turn(ours, theirs, 1, 50))
