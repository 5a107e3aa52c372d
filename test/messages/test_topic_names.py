"""How topics and frames are called."""

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from sesa2.configuration import validate
from sesa2.estimation.estimator import Estimator
from sesa2.estimation.sweeps import Sweep
from sesa2.messages.results import ResultMessages
from sesa2.messages.topic_names import imu_frame, imu_topics, is_called

VALUES = {
    'arm': {'length': 0.3, 'frame_prefix': 'left_'},
    'imus': {'ids': [7, 2], 'positions': [0.1, 0.3], 'base_id': 4},
    'markers': {'names': ['A'], 'positions': [0.2]},
    'models': ['pcc'],
}


def test_topics_go_with_the_ids_and_the_last_is_that_of_the_base():
    assert imu_topics(validate(VALUES)) == {7: 'imu_7/data', 2: 'imu_2/data', 4: 'imu_4/data'}
    named = {**VALUES, 'imus': {**VALUES['imus'], 'topics': ['/a/data', 'b/data', '/base/imu']}}
    assert imu_topics(validate(named)) == {7: '/a/data', 2: 'b/data', 4: '/base/imu'}


@pytest.mark.parametrize(
    ('topic', 'name', 'expected'),
    [
        ('/pcc/tip', 'pcc/tip', True),
        ('/left/pcc/tip', 'pcc/tip', True),
        ('/left/pcc/tip', '/pcc/tip', False),
        ('/left/pcc/tip', '/left/pcc/tip', True),
        ('/left/spcc/tip', 'pcc/tip', False),
        ('/left/pcc/tips', 'pcc/tip', False),
    ],
)
def test_a_relative_name_is_found_in_any_namespace(topic, name, expected):
    assert is_called(topic, name) is expected


@pytest.mark.parametrize(('output', 'frame'), [('base', 'left_base_link'), ('world', 'left_world')])
def test_every_frame_of_every_result_has_the_prefix(output, frame):
    c = validate({**VALUES, 'arm': {**VALUES['arm'], 'output_frame': output}})
    assert imu_frame(c, 7) == 'left_imu_7'
    estimator = Estimator(c)
    messages, store = ResultMessages(c, estimator), get_typestore(Stores.ROS2_JAZZY)
    identity = np.array([0.0, 0.0, 0.0, 1.0])
    estimate = estimator.estimate([Sweep(10**18, np.stack([identity] * 2), np.ones(2, bool), identity)])
    frames = set()
    for topic in messages.topics:
        message = store.deserialize_cdr(messages.make(topic, estimate)[0], topic.type)
        parts = [message, *getattr(message, 'poses', []), *getattr(message, 'markers', [])]
        frames |= {p.header.frame_id for p in parts if hasattr(p, 'header')}
    assert frames == {frame, ''}  # joint states have none
