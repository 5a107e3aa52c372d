"""Messages of the truth, against those that rclpy reads."""

import numpy as np
import pytest

from sesa2.configuration import files
from sesa2.messages.truth_messages import TRUTH_TYPES, TruthMessages

serialization = pytest.importorskip('rclpy.serialization', reason='ROS is not installed')
from geometry_msgs.msg import PoseArray, PoseStamped  # noqa: E402
from nav_msgs.msg import Path  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402

COORDINATES = ['segment_1_bend_x', 'segment_1_bend_y', 'segment_1_length']
STAMP = 1_700_000_000_123_456_789


@pytest.fixture
def messages():
    return TruthMessages(files.load_configuration('tri_backbone'), 3, COORDINATES)


def numbers(pose):
    p, q = pose.position, pose.orientation
    return [p.x, p.y, p.z, q.x, q.y, q.z, q.w]


def test_they_carry_their_numbers_stamp_and_frame(messages):
    poses = np.arange(21.0).reshape(3, 7)
    sent = {
        'truth/tip': poses[:1],
        'truth/markers': poses[:2],
        'truth/shape': poses,
        'truth/coordinates': poses[0, :3],
    }
    assert sent.keys() == TRUTH_TYPES.keys()
    kinds = (PoseStamped, PoseArray, Path, JointState)
    read = {
        topic: serialization.deserialize_message(
            messages.make_truth(topic, np.array([STAMP]), values[None])[0], kind
        )
        for (topic, values), kind in zip(sent.items(), kinds, strict=True)
    }
    for topic, message in read.items():
        assert (message.header.stamp.sec, message.header.stamp.nanosec) == divmod(STAMP, 10**9)
        assert message.header.frame_id == ('' if topic == 'truth/coordinates' else 'base_link')
    assert numbers(read['truth/tip'].pose) == poses[0].tolist()
    assert [numbers(p) for p in read['truth/markers'].poses] == poses[:2].tolist()
    assert [numbers(p.pose) for p in read['truth/shape'].poses] == poses.tolist()
    assert read['truth/coordinates'].name == COORDINATES
    assert list(read['truth/coordinates'].position) == [0.0, 1.0, 2.0]


def test_many_are_made_at_once(messages):
    rows = np.random.default_rng(0).normal(size=(5, 3))
    stamps = STAMP + np.arange(5)
    at_once = messages.make_truth('truth/coordinates', stamps, rows)
    one_by_one = [
        messages.make_truth('truth/coordinates', stamps[k : k + 1], rows[k : k + 1])[0] for k in range(5)
    ]
    assert at_once == one_by_one
