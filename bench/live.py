"""Eight IMUs at 100 Hz through a pseudo-terminal: what the bridge and the estimator cost, and how late a result is.

Three processes: the virtual board, the system under test (this file run as a script, which notes when each sweep's last
byte was read), and here a subscriber like a control node, which notes when the joint states of that sweep arrive.
"""

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
WARM_UP_S = 3.0


def serve(port, seconds, out):
    """The system under test: bridge and estimator, with the time of every sweep's arrival and the processor time."""
    from sesa2.configuration import files
    from sesa2.nodes.serial_bridge import SerialBridge
    from sesa2.system.run import run

    arrivals = {}
    publish = SerialBridge.on_sweep

    def on_sweep(self, data, stamps_ns, accelerations):
        arrivals[stamps_ns[-1]] = time.monotonic_ns()
        publish(self, data, stamps_ns, accelerations)

    SerialBridge.on_sweep = on_sweep
    used = []
    stop = threading.Event()

    def measure():
        time.sleep(WARM_UP_S)
        used.append((time.process_time(), time.monotonic()))
        time.sleep(seconds)
        used.append((time.process_time(), time.monotonic()))
        stop.set()

    threading.Thread(target=measure, daemon=True).start()
    c = files.load(ROOT / 'config/prototype3_8.yaml')
    c = replace(c, run=replace(c.run, source='serial'), serial=replace(c.serial, port=port))
    run(c, stop)
    cpu = (used[1][0] - used[0][0]) / (used[1][1] - used[0][1])
    Path(out).write_text(json.dumps({'cpu': cpu, 'arrivals': arrivals}))


def listen(process):
    """Arrival of each joint state, by its stamp, until the process ends; monotonic, ns."""
    import rclpy
    from rclpy.experimental.events_executor import EventsExecutor
    from sensor_msgs.msg import JointState

    from sesa2.ros.qos import STREAM

    heard = {}

    def hear(data):
        seconds, nanoseconds = np.frombuffer(data, '<u4', 2, 4).tolist()
        heard[seconds * 10**9 + nanoseconds] = time.monotonic_ns()

    rclpy.init(args=[])
    node = rclpy.create_node('control')
    node.create_subscription(JointState, 'pcc/joint_states', hear, STREAM, raw=True)
    executor = EventsExecutor()
    executor.add_node(node)
    while process.poll() is None:
        executor.spin_once(timeout_sec=0.1)
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown()
    return heard


def rows(seconds=60.0):
    """(figure, value, unit, limit)."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)
    with tempfile.TemporaryDirectory() as folder:
        port, out = Path(folder) / 'board', Path(folder) / 'out.json'
        board = subprocess.Popen(
            [sys.executable, '-m', 'sesa2.cli', 'board', '--link', str(port)], stdout=subprocess.DEVNULL
        )
        try:
            while not port.exists():
                time.sleep(0.05)
            process = subprocess.Popen(
                [sys.executable, __file__, str(port), str(seconds), str(out)], stdout=subprocess.DEVNULL
            )
            heard = listen(process)
        finally:
            board.terminate()
            board.wait()
        measured = json.loads(out.read_text())
    arrivals = {int(stamp): at for stamp, at in measured['arrivals'].items()}
    # Between the first and the last that were heard: the system is stopped in the middle of a sweep.
    asked = [stamp for stamp in sorted(arrivals) if min(heard) <= stamp <= max(heard)]
    late = np.array([heard[stamp] - arrivals[stamp] for stamp in asked if stamp in heard]) * 1e-6
    yield f'live {seconds:.0f} s, sweeps without a result', sum(stamp not in heard for stamp in asked), '', 0
    yield 'live, processor time of bridge and estimator', 100 * measured['cpu'], '% of a core', 50
    yield 'live, byte read to joint state received, median', float(np.median(late)), 'ms', None
    yield 'live, byte read to joint state received, p99', float(np.percentile(late, 99)), 'ms', 2


if __name__ == '__main__':
    serve(sys.argv[1], float(sys.argv[2]), sys.argv[3])
