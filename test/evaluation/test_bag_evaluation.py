from dataclasses import replace

import numpy as np
import pytest

from sesa2.configuration import validate
from sesa2.evaluation.bag_evaluation import _Estimate, _in_one_frame, evaluate_bag
from sesa2.evaluation.drawn_pose import DrawnPose
from sesa2.evaluation.trajectory import Trajectory


def test_an_imu_on_the_base_leaves_the_way_between_the_frames_unknown():
    c = validate({'arm': {'length': 0.4}, 'imus': {'ids': [1], 'positions': [0.2], 'base_id': 8}})
    c = replace(c, arm=replace(c.arm, base_orientation=(1.0, 0.0, 0.0, 0.0)))
    truth = Trajectory([0.0, 1.0], np.ones((2, 1, 3)), ('A',))
    pose = DrawnPose([0.0, 0.4], np.zeros((2, 3)))
    same, told = _in_one_frame(truth, 'world', _Estimate(c, {'pcc': truth}, 'base_link', pose), 'none')
    assert same is truth
    assert 'the way from one to the other is not known' in told[0]


def test_a_bag_is_evaluated_from_python(cases):
    """Without a command; the figures are those that the simulated trial's own truth gives."""
    evaluation = evaluate_bag(cases / '00-common/est10', cases / '00-common/trial10', register='rigid')
    medians = [error.median_mm for error in evaluation.models['pcc'].values()]
    assert list(evaluation.models['pcc']) == ['M1', 'M2']
    assert medians == pytest.approx([18.4, 18.9], abs=0.5)
    assert evaluation.pose is not None
