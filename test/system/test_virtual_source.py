"""What the virtual board of a configuration measures, against rotations of scipy's."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sesa2.configuration import validate
from sesa2.system.virtual_source import make_virtual_boards

BASE = Rotation.from_rotvec([0.8, -0.6, 0.3])
ON_BASE = Rotation.from_rotvec([0.1, 2.2, -0.7])  # q_BS
MOUNTINGS = Rotation.random(2, random_state=6)
HEADINGS = [0.5, -1.4]


@pytest.mark.parametrize('base_id', [0, 1, 8])
def test_mountings_and_headings_are_those_that_the_estimator_takes_off(base_id):
    c = validate(
        {
            'arm': {'length': 0.3, 'base_orientation': BASE.as_quat().tolist()},
            'imus': {
                'ids': [2, 5],
                'positions': [0.1, 0.3],
                'mount_orientations': MOUNTINGS.as_quat().ravel().tolist(),
                'headings': HEADINGS,
                'base_id': base_id,
                'base_mount_orientation': (0.992 * ON_BASE.as_quat()).tolist(),
            },
        }
    )
    t = 12.3
    [board] = make_virtual_boards(c)
    with board:
        links = Rotation.from_quat(board.truth(t)[:2])
        ids = c.imus.all_ids
        got = board.arm.orientations(ids, np.full(len(ids), t), np.zeros(len(ids)))
    np.testing.assert_allclose(np.linalg.norm(got, axis=-1), 1.0, atol=1e-12)
    expected = [
        Rotation.from_rotvec([0.0, 0.0, heading]) * link * mounting
        for heading, link, mounting in zip(HEADINGS, links, MOUNTINGS, strict=True)
    ]
    expected += [BASE * ON_BASE] if base_id else []
    np.testing.assert_allclose(
        Rotation.from_quat(got).as_matrix(), [r.as_matrix() for r in expected], atol=1e-9
    )
