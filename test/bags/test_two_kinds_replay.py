"""An arm with IMUs and magnetometers: sweeps of their own for each, results of all in one bag, in order."""

import numpy as np
import pytest
import yaml
from magnetic_bag import CONFIG, FIELD, STORE, field_message, motion, of_z, stamp_of
from paper_arm import PaperArm
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Writer
from scipy.spatial.transform import Rotation

from sesa2.bags.estimate_arrays import read_estimate
from sesa2.bags.replay import replay
from sesa2.configuration import validate
from sesa2.messages.imu_messages import TYPE, ImuMessages

pytest.importorskip('magpylib', reason='magpylib is not installed')

N = 40
EARTH = (20e-6, 0.0, -45e-6)
ENDS = (0.11, 0.22, 0.33)


def configuration(base_id):
    values = yaml.safe_load(CONFIG.read_text('utf-8'))['/**']['ros__parameters']
    values['imus'] = {'ids': [1, 2, 3], 'positions': list(ENDS), 'base_id': base_id}
    values['models'] = ['magnetic', 'pcc_exact']
    values['magnetic']['filter'] = 'none'
    values['magnetometers']['earth_field'] = list(EARTH)
    return validate(values)


def turning(n):
    """How the base turns, (n,) of scipy's rotations."""
    return Rotation.from_rotvec(np.linspace(0.0, 1.2, n)[:, None] * np.array([0.6, 0.8, 0.0]))


def write_both(path, *, base=None, without_base_until=0):
    q, arm = motion(N), PaperArm(3, 4, earth=EARTH)
    base = Rotation.identity(N) if base is None else base
    readings = arm.simulate(q, base.as_quat())
    orientations = {i: base * arm._pose(q, s)[1] for i, s in zip((1, 2, 3), ENDS, strict=True)}
    orientations[4] = base
    makers = {i: ImuMessages(f'imu_{i}') for i in orientations}
    with Writer(path, version=9) as bag:
        fields = {
            i: bag.add_connection(f'/magnetometer_{i}/field', FIELD, typestore=STORE) for i in range(1, 13)
        }
        imus = {i: bag.add_connection(f'/imu_{i}/data', TYPE, typestore=STORE) for i in orientations}
        for k in range(N):
            for place, i in enumerate((4, 1, 2, 3)):
                if i == 4 and k < without_base_until:
                    continue
                stamp = stamp_of(k, 0) - 2_000_000 + place * 100_000
                bag.write(imus[i], stamp, makers[i].make(stamp, orientations[i][k].as_quat()))
            for place in range(12):
                stamp = stamp_of(k, place)
                bag.write(fields[place + 1], stamp, field_message(stamp, of_z(readings[k, place])))
    return path, q


def coordinates_of(out):
    with AnyReader([out]) as reader:
        [topic] = [c for c in reader.connections if c.topic == '/magnetic/coordinates']
        rows = [STORE.deserialize_cdr(raw, topic.msgtype) for _, _, raw in reader.messages([topic])]
        logs = [log for _, log, _ in reader.messages()]
    return rows, logs


def test_each_kind_gives_its_own_at_its_own_stamps(tmp_path):
    bag, q = write_both(tmp_path / 'in')
    summary = replay(bag, configuration(0), tmp_path / 'out')
    assert (summary.sweeps, summary.field_sweeps) == (N, N)
    rows, logs = coordinates_of(tmp_path / 'out')
    np.testing.assert_allclose([row.position for row in rows], q, atol=2e-4)
    assert logs == sorted(logs)
    stamps = [row.header.stamp.sec * 10**9 + row.header.stamp.nanosec for row in rows]
    assert stamps == [stamp_of(k, 11) for k in range(N)]
    found = read_estimate(tmp_path / 'out', ['pcc_exact'])
    assert len(found.stamps_ns) == N
    # The lengths are not measured for the arcs: the tip of an arm that is 1 to 5 % longer is a little further on.
    assert found.models['pcc_exact'].joints.shape[-1] > 0


def test_a_base_that_turns_in_the_field_of_the_earth(tmp_path):
    bag, q = write_both(tmp_path / 'in', base=turning(N))
    replay(bag, configuration(4), tmp_path / 'out')
    rows, _ = coordinates_of(tmp_path / 'out')
    np.testing.assert_allclose([row.position for row in rows], q, atol=2e-4)
    # Had the base not been listened to, 50 µT that turn would bend the arm.
    replay(bag, configuration(0), tmp_path / 'deaf')
    rows, _ = coordinates_of(tmp_path / 'deaf')
    assert np.abs(np.array([row.position for row in rows]) - q).max() > 0.05


def test_before_the_base_is_heard_there_is_no_shape(tmp_path):
    bag, q = write_both(tmp_path / 'in', base=turning(N), without_base_until=10)
    summary = replay(bag, configuration(4), tmp_path / 'out')
    rows, _ = coordinates_of(tmp_path / 'out')
    np.testing.assert_allclose([row.position for row in rows], q[10:], atol=2e-4)
    assert any(
        'fields not used: of a sweep without the orientation of the base' in w for w in summary.warnings
    )
    assert len(rows) == N - 10
