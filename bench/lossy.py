"""Eight IMUs behind a link that loses, repeats, delays and is cut for 5 s: is each result whole, in order and in step?

Four processes: the virtual board, its bridge, the estimator, and this one, which carries the messages from the bridge
to the estimator as a reliable link does, and listens to the tip. What is whole is told by the messages themselves: the
tip of each instant that this process has carried whole is computed again.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict, deque
from functools import partial
from pathlib import Path

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.experimental.events_executor import EventsExecutor
from sensor_msgs.msg import Imu

from sesa2.configuration import files
from sesa2.estimation.estimator import Estimator
from sesa2.estimation.sweeps import Sweep
from sesa2.messages.imu_messages import read_imu
from sesa2.messages.poses import read_pose
from sesa2.ros.qos import BURSTS, STREAM
from sesa2.shape.rotations import IDENTITY, normalize

CONFIGURATION = Path(__file__).resolve().parents[1] / 'config/prototype3_8.yaml'
CASES = ((0.0, 0.0), (0.02, 0.005), (0.02, 0.05), (0.2, 0.005), (0.2, 0.05))  # loss, delay in s
CUT_S = 5.0
START_S = 3.0  # while topics are connected and the board's clock is learnt
ALIKE_M = 1e-9
NS = 10**9


class Link:
    """Carries messages; one that is lost is sent again after twice the delay and 10 ms, those after it wait."""

    def __init__(self, node, ids, loss, delay):
        self._rng = np.random.default_rng(round(1000 * (loss + delay)))
        self._loss, self._delay = loss, delay
        self.is_cut = False
        self.carried = defaultdict(list)
        self._queues = []
        for i in ids:
            queue = deque()
            self._queues.append((i, node.create_publisher(Imu, f'/imu_{i}/data', BURSTS), queue))
            node.create_subscription(
                Imu, f'/board/imu_{i}/data', partial(self._take, queue), STREAM, raw=True
            )
        node.create_timer(0.002, self._deliver)

    def _take(self, queue, data):
        repeated = self._rng.geometric(1.0 - self._loss) - 1
        due = time.monotonic() + self._delay + repeated * (2 * self._delay + 0.01)
        queue.append((due, bytes(data)))

    def _deliver(self):
        now = time.monotonic()
        for i, publisher, queue in self._queues:
            if self.is_cut:
                while len(queue) > STREAM.depth:  # as much as a publisher keeps
                    queue.popleft()
            while not self.is_cut and queue and queue[0][0] <= now:
                data = queue.popleft()[1]
                publisher.publish(data)
                self.carried[i].append(read_imu(data))


def carry(loss, delay, seconds):
    """What came over the link of each IMU, and (stamp, arrival, position) of each tip heard."""
    c = files.load(CONFIGURATION)
    running = []
    with tempfile.TemporaryDirectory() as folder:
        port = Path(folder) / 'board'
        parameters = Path(folder) / 'arm.yaml'
        parameters.write_text(CONFIGURATION.read_text().replace('/dev/ttyACM0', str(port)))
        board = ['-m', 'sesa2.cli', 'board', '--link', port]
        ros = ['--ros-args', '--params-file', parameters]
        try:
            running.append(start(board))
            while not port.exists():
                time.sleep(0.05)
            running.append(start(['-m', 'sesa2.nodes.estimator', *ros]))
            rclpy.init(args=[])
            node = rclpy.create_node('link')
            link, tips = Link(node, c.imus.ids, loss, delay), []

            def hear(data):
                tip = read_pose(data)
                tips.append((tip.stamp_ns, time.monotonic(), tip.poses[0, :3]))

            node.create_subscription(PoseStamped, '/pcc/tip', hear, BURSTS, raw=True)
            executor = EventsExecutor()
            executor.add_node(node)
            while not node.count_subscribers('/imu_1/data'):
                executor.spin_once(timeout_sec=0.1)
            running.append(start(['-m', 'sesa2.nodes.serial_bridge', *ros, '-r', '__ns:=/board']))
            while len(tips) < 100:
                executor.spin_once(timeout_sec=0.1)
            cuts = [seconds / 3, seconds / 3 + CUT_S] if loss or delay else [np.inf, np.inf]
            began = time.monotonic()
            while (passed := time.monotonic() - began) < seconds:
                link.is_cut = cuts[0] <= passed < cuts[1]
                executor.spin_once(timeout_sec=0.05)
            executor.shutdown()
            node.destroy_node()
            rclpy.try_shutdown()
        finally:
            for process in reversed(running):
                process.send_signal(signal.SIGINT)
                process.wait()
    return c, link.carried, tips


def start(arguments):
    """A process of Python."""
    return subprocess.Popen([sys.executable, *map(str, arguments)], stdout=subprocess.DEVNULL)


def judge(c, carried, tips):
    """What came out: a figure of each kind, by its name."""
    stamps = np.array([stamp for stamp, _, _ in tips])
    positions = np.array([position for _, _, position in tips])
    ids = c.imus.ids
    firsts = np.array([sample.stamp_ns for sample in carried[ids[0]]])
    instants = defaultdict(dict)
    for i in ids:
        for sample in carried[i]:
            k = np.searchsorted(firsts, sample.stamp_ns, side='right') - 1
            if sample.stamp_ns - firsts[k] < NS // 100:
                instants[k][i] = sample
    sweeps = []
    for _, one in sorted(instants.items()):
        measured = np.array([i in one for i in ids])
        q = np.array([one[i][1:] if i in one else IDENTITY for i in ids])
        sweeps.append(Sweep(max(s.stamp_ns for s in one.values()), normalize(q), measured, None))
    expected = {}
    estimator = Estimator(c)
    for begin in range(0, len(sweeps), 256):
        estimate = estimator.estimate(sweeps[begin : begin + 256])
        expected |= dict(zip(estimate.stamps_ns.tolist(), estimate.models['pcc'].ends[:, -1], strict=True))
    whole = {sweep.stamp_ns for sweep in sweeps if sweep.measured.all()}
    partial = sum(stamp not in whole for stamp in stamps.tolist())
    wrong = sum(
        stamp not in expected or np.linalg.norm(position - expected[stamp]) > ALIKE_M
        for stamp, position in zip(stamps.tolist(), positions, strict=True)
    )
    heard = set(stamps.tolist())
    asked = [s for s in whole if stamps[0] <= s <= stamps[-1]]
    settled = stamps >= stamps[0] + START_S * NS
    seconds = (stamps[settled] - stamps[0]) // NS
    step = 0.0
    for k in (1, 2):
        near = stamps[k:] - stamps[:-k] < 20_500_000
        steps = np.linalg.norm(positions[k:] - positions[:-k], axis=1)
        step = max(step, steps[near].max(initial=0.0))
    return {
        'most results of a second': int(np.bincount(seconds).max()),
        'stamps back': int((np.diff(stamps) <= 0).sum()),
        f'of {len(stamps)} results, not what the messages say': wrong,
        'lacking an IMU whose message was lost in the cut': partial,
        'whole instants without a result': len([s for s in asked if s not in heard]),
        'largest step of the tip in 20 ms, mm': 1000 * step,
    }


def rows(seconds=20.0):
    """(figure, value, unit, limit)."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)
    healthy = None
    for loss, delay in CASES:
        figures = judge(*carry(loss, delay, seconds))
        link = f'link {100 * loss:.0f} % {1000 * delay:.0f} ms' + (f', cut {CUT_S:.0f} s' if loss else '')
        *_, step = figures.values()
        healthy = step if healthy is None else healthy
        # Of the instants at either end of a cut not all messages come; they are counted as dropped.
        limits = (101, 0, 0, None if loss else 0, 1 if loss else 0, 3 * healthy)
        for (name, value), limit in zip(figures.items(), limits, strict=True):
            yield f'{link}: {name}', value, '', limit


def main():
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seconds', type=float, default=20.0, help='length of each measurement')
    for figure, value, unit, limit in rows(parser.parse_args().seconds):
        print(f'{figure}: {value:.3g} {unit}' + ('' if limit is None else f' (≤ {limit:.3g})'), flush=True)


if __name__ == '__main__':
    main()
