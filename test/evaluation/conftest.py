import os
from pathlib import Path

import numpy as np
import pytest
from made_motion import NAMES, Motion

from sesa2.evaluation.trajectory import Trajectory

ARC_LENGTHS = {'M1': 0.36, 'M2': 0.60}
DATA = Path(os.environ.get('SESA2_DATA', Path(__file__).parents[2] / '..' / 'shared' / 'data'))


@pytest.fixture
def motion():
    return Motion()


@pytest.fixture(scope='session')
def twin():
    """The simulated trial: measured orientations' times, an estimate and the truth."""
    path = DATA / 'twin' / 'trial_A_bno055_seed1.npz'
    if not path.exists():
        pytest.skip(f'{path} is absent: the simulated trial is not part of the repository')
    trial = np.load(path)
    return (
        Trajectory(trial['ti'], tangent_estimate(trial['q']), NAMES),
        Trajectory(trial['t100'], trial['M100'], NAMES),
    )


def tangent_estimate(q_wxyz):
    """Markers from tangents interpolated linearly over the arc length and integrated: plain, and no model of ours."""
    w, x, y, z = np.moveaxis(q_wxyz.astype(float), -1, 0)
    tangents = np.stack((2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)), axis=-1)
    step = 0.08
    total = np.concatenate(
        (np.zeros((len(q_wxyz), 1, 3)), np.cumsum(0.5 * step * (tangents[:, 1:] + tangents[:, :-1]), axis=1)),
        axis=1,
    )
    markers = []
    for s in ARC_LENGTHS.values():
        i = int(s / step)
        f = s / step - i
        within = step * (f * tangents[:, i] + 0.5 * f * f * (tangents[:, i + 1] - tangents[:, i]))
        markers.append(total[:, i] + within)
    return np.stack(markers, axis=1)
