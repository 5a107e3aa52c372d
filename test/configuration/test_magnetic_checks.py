"""What can be wrong with magnets and magnetometers: all at once, each with its place."""

import numpy as np
import pytest

from sesa2.configuration import ConfigurationError, files, validate
from sesa2.configuration.description import describe


def values(**changes):
    """Two segments, a magnet in each, two magnetometers; `section__key=value` changes it, None takes a key away."""
    base = {
        'arm': {'length': 0.2},
        'segments': {'lengths': [0.1, 0.1], 'stretch': [0.9, 1.2]},
        'magnets': {
            'segments': [1, 2],
            'positions': [0.05, 0.05],
            'outer_diameters': [0.01],
            'heights': [0.005],
            'remanences': [1.3, -1.3],
        },
        'magnetometers': {'ids': [4, 9], 'segments': [1, 2], 'positions': [0.1, 0.09], 'radii': [0.01, 0.0]},
        'models': ['magnetic'],
    }
    for path, value in changes.items():
        section, _, key = path.partition('__')
        target = base.setdefault(section, {}) if key else base
        if value is None:
            target.pop(key or section)
        else:
            target[key or section] = value
    return base


def mistakes(**changes):
    with pytest.raises(ConfigurationError) as caught:
        validate(values(**changes))
    return [f'{m.place}: {m.message}' for m in caught.value.mistakes]


def test_an_arm_without_imus():
    c = validate(values())
    assert c.imus.ids == ()
    assert c.layout.n_magnetometers == 2
    assert files.parse(files.dump(c), 'dump') == c
    text = describe(c)
    assert 'IMUs, base to tip\n  none' in text
    assert 'Suits' not in text
    assert any(line.split() == ['9', '0.1900', '0.0', '0.0', 'xyz'] for line in text.splitlines())


def test_an_arm_with_imus_too():
    c = validate(values(imus={'ids': [1], 'positions': [0.2]}, models=['pcc_exact', 'magnetic']))
    assert c.layout.n_imu == 1
    assert 'Suits' in describe(c)
    assert mistakes(imus={'ids': [1]}) == ['imus.positions: is missing']
    assert mistakes(models=['pcc']) == ["pcc: imu_positions is empty, the model 'pcc' needs at least one IMU"]


def test_lists_of_one_stand_for_all():
    c = validate(
        values(
            magnetometers__gains=[1.1], magnetometers__axes=['z', 'xyz'], magnetometers__offsets=[1e-6, 2e-6]
        )
    )
    predictor = c.create_model('magnetic').predictor
    assert [m.remanence for m in predictor.magnets.magnets] == [1.3, -1.3]
    assert [m.outer_diameter for m in predictor.magnets.magnets] == [0.01, 0.01]
    np.testing.assert_allclose(predictor.magnets.positions, [0.05, 0.15])
    np.testing.assert_allclose(predictor.magnetometers.positions, [0.1, 0.19])
    np.testing.assert_allclose(predictor.magnetometers.offsets, [1e-6, 2e-6, 2e-6, 2e-6])
    np.testing.assert_allclose(predictor.magnetometers.gains, [1.1, 1.1])
    np.testing.assert_allclose(predictor.limits.scales, [1.6, 1.6, 0.03] * 2)


def test_a_magnetometer_that_is_not_used():
    c = validate(values(magnetometers__masked=[4], magnetometers__offsets=[1e-6, 2e-6]))
    predictor = c.create_model('magnetic').predictor
    assert predictor.names == ('magnetometer_9',)
    assert predictor.readings_of([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]).tolist() == [4.0, 5.0, 6.0]
    np.testing.assert_allclose(predictor.magnetometers.offsets, 3 * [2e-6])


@pytest.mark.parametrize(
    ('changes', 'expected'),
    [
        ({'segments': None}, 'segments.lengths: is missing, and magnetometers need it'),
        ({'magnets': None}, 'magnets.segments: is missing, and magnetometers need it'),
        ({'magnetometers__ids': None}, 'imus.ids: is missing'),
        ({'magnets__segments': [1, 3]}, 'magnets.segments[1]: got 3, expected 1 to 2, a segment'),
        (
            {'magnets__positions': [0.05]},
            'magnets.positions: has 1 entries, expected 2: one per entry of segments',
        ),
        ({'magnets__positions': [0.05, 0.11]}, 'magnets.positions[1]: 0.11 m is beyond the end of segment 2'),
        ({'magnets__heights': None}, 'magnets.heights: has 0 entries, expected 1 or 2: one for all or'),
        (
            {'magnets__inner_diameters': [0.01]},
            'magnets.inner_diameters[0]: got 0.01 m, expected less than the outer',
        ),
        ({'magnets__remanences': [0.0]}, 'magnets.remanences[0]: got 0, expected another number'),
        ({'magnets__remanences': [1450.0]}, 'magnets.remanences[0]: got 1450.0, expected -2 to 2'),
        ({'magnetometers__ids': [4, 4]}, 'magnetometers.ids[1]: got 4 a second time'),
        ({'magnetometers__segments': [1]}, 'magnetometers.segments: has 1 entries, expected 2: one per id'),
        (
            {'magnetometers__positions': [0.1, 0.2]},
            'magnetometers.positions[1]: 0.2 m is beyond the end of segment 2',
        ),
        ({'magnetometers__axes': ['y']}, 'magnetometers.axes[0]: got'),
        ({'magnetometers__radii': [0.01] * 3}, 'magnetometers.radii: has 3 entries, expected 1 or 2'),
        ({'magnetometers__offsets': [0.0] * 3}, 'magnetometers.offsets: has 3 entries, expected 1, 2 or 6'),
        ({'magnetometers__mount_orientations': [0.0] * 5}, 'magnetometers.mount_orientations: has 5 numbers'),
        (
            {'magnetometers__mount_orientations': [1.0, 1.0, 0.0, 0.0]},
            'magnetometers.mount_orientations[0:4]',
        ),
        (
            {'magnetometers__earth_field': [0.0]},
            'magnetometers.earth_field: has 1 numbers, expected 3: x y z',
        ),
        (
            {'magnetometers__earth_field': [0.0, 0.0, 48.0]},
            'magnetometers.earth_field[2]: got 48.0',
        ),
        ({'magnetometers__masked': [9, 4]}, 'magnetometers.masked: got every id, expected at least one'),
        ({'magnetometers__masked': [7]}, 'magnetometers.masked[0]: got 7, expected one of magnetometers.ids'),
        ({'magnetometers__range': 0.0}, 'magnetometers.range: got 0.0, expected more than 0'),
        (
            {'magnetometers__positions': [0.055, 0.09]},
            'magnetometers.positions[0]: is 11.2 mm from the centre of magnet 1, expected at least',
        ),
        ({'magnetic': {'kinematics': 'arcs'}}, "magnetic.kinematics: got 'arcs', expected one of"),
        ({'magnetic': {'filter': 'kalman'}}, "magnetic.filter: got 'kalman', expected one of none"),
    ],
)
def test_a_mistake_is_named(changes, expected):
    found = mistakes(**changes)
    assert any(m.startswith(expected) for m in found), found


def test_magnets_without_magnetometers():
    found = mistakes(magnetometers=None, imus={'ids': [1], 'positions': [0.1]}, models=['pcc'])
    assert found == ['magnetometers.ids: is missing, and there are magnets']


def test_all_at_once():
    found = mistakes(
        magnets__heights=[0.1] * 3,
        magnetometers__gains=[1.0] * 4,
        magnetometers__ids=[1, 1],
        magnets__segments=[1, 7],
    )
    assert len(found) == 4
