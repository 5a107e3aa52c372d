"""Recordings whose ids are not those of the configuration."""

import numpy as np
import pytest
from made_bags import stamps_of, write_bag

from sesa2.bags.reading import read_poses
from sesa2.bags.recorded_sweeps import read_sweeps
from sesa2.bags.replay import replay
from sesa2.configuration import files, validate
from sesa2.errors import Sesa2Error

ZERO = [f'/imu_{k}/data' for k in range(4)]


def arm(**imus):
    return validate(
        {
            'arm': {'length': 0.66},
            'imus': {'ids': [2, 4, 6, 8], 'positions': [0.16, 0.32, 0.48, 0.64], **imus},
            'markers': {'names': ['M'], 'positions': [0.6]},
            'models': ['pcc'],
        }
    )


def test_an_arm_is_not_estimated_from_one_imu_that_happens_to_fit(tmp_path):
    bag = write_bag(tmp_path / 'in', (0, 1, 2, 3), stamps_of(0.2))
    wanted = 'no message of the IMUs 4, 6, 8; it has topics of 0, 1, 2, 3: say in imus.ids or imus.topics'
    with pytest.raises(Sesa2Error, match=wanted):
        replay(bag, arm(), tmp_path / 'out')
    assert not (tmp_path / 'out').exists()
    with pytest.raises(Sesa2Error, match=wanted):
        read_sweeps(bag, arm())


def test_names_of_topics_say_which_is_whose(tmp_path):
    zero = write_bag(tmp_path / 'zero', (0, 1, 2, 3), stamps_of(0.2))
    right = write_bag(tmp_path / 'right', (2, 4, 6, 8), stamps_of(0.2))
    assert replay(zero, arm(topics=ZERO), tmp_path / 'a').warnings == []
    assert replay(right, arm(), tmp_path / 'b').warnings == []
    a, b = (read_poses(tmp_path / name, 'pcc/markers').positions for name in 'ab')
    np.testing.assert_array_equal(a, b)


def test_one_imu_that_is_missing_is_told_and_the_rest_is_used(tmp_path):
    bag = write_bag(tmp_path / 'in', (2, 4, 8), stamps_of(0.2))
    warnings = replay(bag, arm(), tmp_path / 'out').warnings
    assert warnings[0] == 'IMU 6: no message'


def test_the_case(cases, tmp_path):
    bag = cases / '07-ids-from-zero/bag'
    c = files.load(files.find('prototype3_4'))
    with pytest.raises(Sesa2Error, match='no message of the IMUs 4, 6, 8; it has topics of 0, 1, 2, 3'):
        replay(bag, c, tmp_path / 'out', models=['pcc'])
    text = files.dump(c).replace('    imus:\n', f'    imus:\n      topics: {ZERO}\n')
    summary = replay(bag, files.parse(text, 'test'), tmp_path / 'out', models=['pcc'])
    assert (summary.sweeps, summary.partial, summary.warnings) == (60, 0, [])
    whole = read_poses(cases / '00-common/est10', 'pcc/markers')
    piece = read_poses(tmp_path / 'out', 'pcc/markers')
    nearest = np.abs(whole.times_s - piece.times_s[:, None]).argmin(axis=1)
    np.testing.assert_allclose(whole.positions[nearest], piece.positions, atol=2e-3)
