"""Readings of magnetometers from bags and columns."""

import numpy as np
import pytest

from sesa2.bags.magnetometer_log import read_magnetometers
from sesa2.bags.writing import new_bag
from sesa2.errors import Sesa2Error
from sesa2.messages.field_messages import FIELD_TYPE, FieldMessages

T0 = 1_700_000_000_000_000_000


def write(path, rows):
    """Messages: topic, stamp, when it was recorded, field; a field of None is a damaged one."""
    with new_bag(path) as bag:
        topics = {topic: bag.add_topic(topic, FIELD_TYPE) for topic in dict.fromkeys(row[0] for row in rows)}
        for topic, stamp, log, field in rows:
            made = FieldMessages('m').make_fields(np.array([stamp]), np.array([field or (0.0, 0.0, 0.0)]))
            data = made[0].tobytes() if field else made[0].tobytes()[:20]
            bag.write(topics[topic], log, data)
    return path


def test_a_bag(tmp_path):
    s = 1_000_000_000
    path = write(
        tmp_path / 'bag',
        [
            ('/a/magnetometer_2/field', T0, T0, (1e-6, 2e-6, 3e-6)),
            ('/a/magnetometer_2/field', T0 + s, T0 + s, (4e-6, np.nan, 6e-6)),
            ('/a/magnetometer_2/field', T0 + s, T0 + s, (4e-6, np.nan, 6e-6)),
            ('/a/magnetometer_2/field', 0, T0 + 2 * s, (7e-6, 8e-6, 9e-6)),
            ('/a/magnetometer_2/field', T0 + 3 * s, T0 + 3 * s, None),
            ('/a/magnetometer_5/field', T0, T0, (0.0, 0.0, 1e-6)),
            ('/a/imu_1/mag', T0, T0, (0.0, 0.0, 1e-6)),
        ],
    )
    log = read_magnetometers(path, [2, 3])
    np.testing.assert_allclose(log.times[2] - log.start, [0.0, 1.0, 2.0], atol=1e-6)
    np.testing.assert_array_equal(
        log.fields[2], [[1e-6, 2e-6, 3e-6], [4e-6, np.nan, 6e-6], [7e-6, 8e-6, 9e-6]]
    )
    assert set(log.fields) == {2}
    said = '; '.join(log.problems)
    for text in (
        '2: 1 messages not used: damaged',
        '5: not in magnetometers.ids',
        '3: no reading',
        '2: 1 readings with',
    ):
        assert f'magnetometer {text}' in said


def test_of_several_arms_or_none(tmp_path):
    rows = [(f'/{arm}/magnetometer_1/field', T0, T0, (0.0, 0.0, 1.0)) for arm in 'ab']
    with pytest.raises(Sesa2Error, match='namespaces /a/ and /b/'):
        read_magnetometers(write(tmp_path / 'two', rows), [1])
    with pytest.raises(Sesa2Error, match=r'no reading of the magnetometers 1; expected topics'):
        read_magnetometers(write(tmp_path / 'none', [('/a/imu_1/mag', T0, T0, (0.0, 0.0, 1.0))]), [1])


def test_columns(tmp_path):
    path = tmp_path / 'log.csv'
    path.write_text(
        'time_ms;magnetometer_1_x [mT];magnetometer_1_z [mT];magnetometer_2\n0;1;2;3e-6\n20;;;4e-6\n'
    )
    log = read_magnetometers(path, [1, 2])
    np.testing.assert_array_equal(log.fields[1], [[1e-3, np.nan, 2e-3]])
    np.testing.assert_array_equal(log.fields[2][:, 2], [3e-6, 4e-6])
    np.testing.assert_allclose(log.times[2], [0.0, 0.02])


def test_between_readings_and_in_gaps(tmp_path):
    path = tmp_path / 'log.csv'
    times = [0.0, 0.1, 0.2, 0.3, 2.0, 2.1]
    path.write_text('time_s,magnetometer_1\n' + ''.join(f'{t},{t}e-3\n' for t in times))
    at = read_magnetometers(path, [1]).at(np.array([-0.1, 0.0, 0.15, 1.0, 2.05, 2.2]), [1, 7])
    np.testing.assert_allclose(at[:, 0, 2], [np.nan, 0.0, 0.15e-3, np.nan, 2.05e-3, np.nan], atol=1e-15)
    assert np.isnan(at[:, 1]).all()


def test_a_part(tmp_path):
    path = tmp_path / 'log.csv'
    path.write_text('time_s,magnetometer_1\n' + ''.join(f'{5 + 0.1 * k:.1f},1e-3\n' for k in range(20)))
    log = read_magnetometers(path, [1])
    np.testing.assert_allclose(log.part(0.5, 0.29).times[1], [5.5, 5.6, 5.7])
    with pytest.raises(Sesa2Error, match=r'no reading from 9 s on; there are 1\.9 s'):
        log.part(9.0, 1.0)
