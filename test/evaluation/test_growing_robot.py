"""A real robot that extends, twists and hardly bends (hsa): its motion-capture bodies are the IMUs, their distance the
measured length. What lies between bodies and arm is fitted on one half and scored on the other.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sesa2.evaluation.evaluate import evaluate
from sesa2.evaluation.trajectory import Trajectory
from sesa2.shape.arm import Arm
from sesa2.shape.layout import Layout
from sesa2.shape.measured import Measured
from sesa2.shape.models import create_model

BASE, PLATFORM = 2, 3
EXTENDING, TWISTING = '20221011_174514', '20221012_103309'


@pytest.fixture
def bodies(recordings):
    """Of a recording: orientation of the platform in the base, as quaternions, and its position there, m."""

    def read(name):
        path = recordings / f'hsa/{name}_mocap_frame_data_history.csv'
        if not path.exists():
            pytest.skip(f'no {path}')
        rows = np.genfromtxt(path, delimiter=',')
        # Their robot stands along y, ours along z.
        turn = Rotation.from_euler('x', -90.0, degrees=True)
        base, platform = (rows[rows[:, 1] == body] for body in (BASE, PLATFORM))
        q = [Rotation.from_quat(body[:, 2:6]) * turn for body in (base, platform)]
        return (q[0].inv() * q[1]).as_quat(), q[0].inv().apply(platform[:, 6:] - base[:, 6:])

    return read


def left(q, p, register, *, twist, known):
    """Median error on the second half, mm."""
    distance = np.linalg.norm(p, axis=1)
    rest = float(np.median(distance))
    layout = Layout(Arm(rest), (rest,), (rest,), stretches=True)
    model = create_model('pcc_delta', layout, twist=twist)
    length = np.full(len(q), rest)
    if known:  # the arc whose ends are as far apart as the bodies
        bend = model.fit(Measured(q[:, None], lengths=length[:, None])).coordinates[:, :2]
        length = distance / np.sinc(np.linalg.norm(bend, axis=1) / (2.0 * np.pi))
    shape = model.fit(Measured(q[:, None], lengths=length[:, None]))
    # A tip that owns the twist is oriented as measured.
    links = q[:, None] if twist == 'tip' else shape.orientations([rest])
    times = np.arange(len(q)) / 40.0
    estimate = Trajectory(times, shape.positions([rest]), ('platform',), links)
    truth = Trajectory(times, p[:, None], ('platform',))
    found = evaluate(
        {'pcc_delta': estimate},
        truth,
        {'platform': rest},
        register=register,
        fit_fraction=0.5,
        time_offset=0.0,
    )
    return found.models['pcc_delta']['platform'].median_mm


def test_with_its_length_known_the_extension_is_met(bodies):
    q, p = bodies(EXTENDING)
    assert left(q, p, 'translation', twist='shared', known=False) == pytest.approx(15.6, abs=0.1)
    for twist in ('shared', 'tip', 'base'):
        assert left(q, p, 'offsets', twist=twist, known=True) < 1.0


def test_a_robot_that_twists_is_met_where_the_tip_owns_the_twist(bodies):
    q, p = bodies(TWISTING)
    assert left(q, p, 'rigid+offsets', twist='tip', known=True) < 1.7
    by_owner = {twist: left(q, p, 'offsets', twist=twist, known=True) for twist in ('shared', 'tip', 'base')}
    assert by_owner['tip'] < 2.0
    assert min(by_owner['shared'], by_owner['base']) > 2.0 * by_owner['tip']
    assert left(q, p, 'offsets', twist='tip', known=False) > by_owner['tip'] + 1.0


def test_the_twist_is_told(bodies):
    q, _ = bodies(TWISTING)
    shape = create_model('pcc_delta', Layout(Arm(0.13), (0.13,))).fit(Measured(q[:, None]))
    twist = np.degrees(shape.twists[:, 0])
    assert twist.min() < -45.0
    assert twist.max() > 45.0
    assert np.degrees(np.linalg.norm(shape.coordinates[:, :2], axis=1)).max() < 14.0
