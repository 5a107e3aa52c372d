"""The estimator behind a link that loses, repeats and delays: a node between board and estimator is that link."""

import time
from collections import deque

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import Imu
from virtual_arms import arm_of

from sesa2.configuration import validate
from sesa2.messages.header_bytes import read_stamp
from sesa2.nodes.estimator import EstimatorNode
from sesa2.nodes.serial_bridge import SerialBridge
from sesa2.ros.qos import BURSTS, STREAM

IDS = range(1, 9)
VALUES = {
    'arm': {'length': 0.66},
    'imus': {'ids': list(IDS), 'positions': [round(0.08 * k, 2) for k in IDS]},
    'models': ['pcc'],
}


class Link(rclpy.node.Node):
    """Carries the IMUs' messages from the board's namespace to the estimator's, as a reliable link does.

    A message that is lost is sent again after twice the delay and 10 ms; those after it on its topic wait.
    """

    def __init__(self, loss, delay, seed):
        super().__init__('link')
        self._rng = np.random.default_rng(seed)
        self._loss, self._delay = loss, delay
        self.is_cut = False
        self.carried = {i: [] for i in IDS}
        self._queues = []
        self._subscriptions_of_imus = [
            self.create_subscription(Imu, f'/board/imu_{i}/data', self._carry(i), STREAM, raw=True)
            for i in IDS
        ]
        self._timer = self.create_timer(0.002, self._deliver)

    def _carry(self, imu):
        queue = deque()
        self._queues.append((imu, self.create_publisher(Imu, f'/imu_{imu}/data', BURSTS), queue))

        def carry(data):
            repeated = self._rng.geometric(1.0 - self._loss) - 1
            queue.append((time.monotonic() + self._delay + repeated * (2 * self._delay + 0.01), data))

        return carry

    def _deliver(self):
        now = time.monotonic()
        for imu, publisher, queue in self._queues:
            if self.is_cut:
                while len(queue) > STREAM.depth:  # as much as a publisher keeps
                    queue.popleft()
            else:
                while queue and queue[0][0] <= now:
                    data = queue.popleft()[1]
                    self.carried[imu].append(read_stamp(data))
                    publisher.publish(data)


class Bench:
    """A virtual board, its bridge, the link and the estimator; what came out of it."""

    def __init__(self, graph, configured, boards, *, loss, delay):
        self.graph = graph
        board = boards(arm_of(validate(VALUES)))
        overrides = configured({**VALUES, 'serial': {'port': board.path}})
        self.estimator = graph.add(EstimatorNode(parameter_overrides=overrides))
        self.sweeps = []
        estimate = self.estimator._estimator.estimate

        def noting(sweeps):
            self.sweeps += sweeps
            return estimate(sweeps)

        self.estimator._estimator.estimate = noting
        self.tips = graph.listen(PoseStamped, '/pcc/tip', STREAM)
        self.link = graph.add(Link(loss, delay, seed=round(1000 * (loss + delay))))
        self.bridge = graph.add(SerialBridge(parameter_overrides=overrides, namespace='board'))

    def run(self, n):
        """Spin until there are so many results more."""
        until = len(self.tips) + n
        self.graph.until(lambda: len(self.tips) >= until, f'{n} results')
        return self

    def assert_whole_and_in_order(self, healthy_step, n_partial=0):
        stamps = np.array([s.stamp_ns for s in self.sweeps])
        assert (np.diff(stamps) > 0).all()
        told = f'{dict(self.estimator.received)} {self.estimator.assembler.dropped}'
        # An IMU that lacks has measured nothing that the link did not lose for good.
        for s in self.sweeps:
            for i in np.flatnonzero(~s.measured) + 1:
                carried = np.array(self.link.carried[i])
                assert np.abs(carried - s.stamp_ns).min() > 4_000_000, (s, told)
            assert s.measured.sum() >= len(IDS) / 2, told
        partial = sum(not s.measured.all() for s in self.sweeps)
        assert partial <= n_partial, told
        # Every instant that has come of all IMUs gave one, but for the first while topics were connected.
        received = min(self.estimator.received[i] for i in IDS)
        assert received - 10 <= len(stamps) - partial <= received
        # In the first second the stamps are still catching up with the board's clock.
        assert max(np.bincount((stamps - stamps[0]) // 10**9)[1:]) <= 101
        stamps_told = [t.header.stamp.sec * 10**9 + t.header.stamp.nanosec for t in self.tips]
        assert stamps_told in (stamps[-len(stamps_told) :].tolist(), stamps[: len(stamps_told)].tolist())
        assert self.step() <= 3.0 * healthy_step
        assert not self.estimator.assembler.dropped['later than its sweep could wait']

    def step(self):
        """The largest step of the tip within 20 ms, m."""
        t = np.array([t.header.stamp.sec + 1e-9 * t.header.stamp.nanosec for t in self.tips])
        p = np.array([[m.pose.position.x, m.pose.position.y, m.pose.position.z] for m in self.tips])
        steps = [
            np.linalg.norm(p[k:] - p[:-k], axis=1)[t[k:] - t[:-k] < 0.0205].max(initial=0.0) for k in (1, 2)
        ]
        return max(steps)


# The largest step of the virtual arm's tip within 20 ms in its first seconds, m; `test_a_healthy_link` keeps it true.
HEALTHY_STEP = 0.0145


def test_a_healthy_link(graph, configured, boards):
    bench = Bench(graph, configured, boards, loss=0.0, delay=0.0).run(500)
    bench.assert_whole_and_in_order(HEALTHY_STEP)
    assert bench.step() <= HEALTHY_STEP


@pytest.mark.parametrize('delay', [0.005, 0.05])
@pytest.mark.parametrize('loss', [0.02, 0.2])
def test_a_link_that_loses_and_repeats(graph, configured, boards, loss, delay):
    Bench(graph, configured, boards, loss=loss, delay=delay).run(500).assert_whole_and_in_order(HEALTHY_STEP)


@pytest.mark.parametrize(('loss', 'delay'), [(0.02, 0.005), (0.2, 0.05)])
def test_a_link_that_is_cut_for_a_while(graph, configured, boards, loss, delay):
    bench = Bench(graph, configured, boards, loss=loss, delay=delay).run(100)
    bench.link.is_cut = True
    began = time.monotonic()
    graph.until(lambda: time.monotonic() > began + 5.0, 'the cut')
    bench.link.is_cut = False
    # Topics of which packets were lost are behind the others when it comes: by as much they lack an IMU.
    bench.run(300).assert_whole_and_in_order(HEALTHY_STEP, n_partial=100)
