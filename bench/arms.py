"""Four arms of eight IMUs at 100 Hz, each a `sesa2 run` in its namespace: what they cost, and whether a sweep is lost.

The virtual boards are processes apart, whose time is not counted; so is what this file itself takes: it listens to each
arm's joint states and tip by one model, as a control node does.
"""

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.experimental.events_executor import EventsExecutor
from sensor_msgs.msg import JointState

from sesa2.messages.header_bytes import read_stamp
from sesa2.ros.qos import STREAM

ARMS = ('left', 'right', 'front', 'back')
TOPICS = {'joint_states': JointState, 'tip': PoseStamped}
PERIOD_NS = 10_000_000
WARM_UP_S = 5.0
_TICK_S = 1.0 / os.sysconf('SC_CLK_TCK')


def rows(seconds=60.0):
    """(figure, value, unit, limit)."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)
    with tempfile.TemporaryDirectory() as folder:
        boards, runs = [], []
        try:
            for arm in ARMS:
                port = Path(folder) / arm
                boards.append(start(folder, f'{arm}_board', 'board', '--link', port))
                while not port.exists():
                    time.sleep(0.05)
                on = ('--source', 'serial', '--port', port, '--namespace', arm)
                runs.append(start(folder, f'{arm}_run', 'run', '--config', 'prototype3_8', *on))
            with listening() as (hear, heard):
                hear(WARM_UP_S)
                for stamps in heard.values():  # those while topics were connected
                    stamps.clear()
                before, began = [used(run) for run in runs], time.monotonic()
                hear(seconds)
                after, elapsed = [used(run) for run in runs], time.monotonic() - began
        finally:
            for process in (*runs, *boards):
                process.send_signal(signal.SIGINT)
                process.wait()
        told = [(Path(folder) / f'{arm}_run').read_text() for arm in ARMS]
    lost = sum(int(re.findall(r'lost (\d+) sweeps', text)[-1]) for text in told)
    estimated = [int(re.findall(r'(\d+) sweeps estimated', text)[-1]) for text in told]
    dropped = sum(int(n) for text in told for n in re.findall(r'(\d+) samples dropped', text))
    share = 100.0 * (sum(after) - sum(before)) / elapsed
    yield f'{len(ARMS)} arms {seconds:.0f} s, sweeps lost', lost, '', 0
    yield f'{len(ARMS)} arms, samples dropped', dropped, '', 0
    gaps = [np.diff(sorted(stamps)) for stamps in heard.values()]
    missed = sum(int(np.rint(gap / PERIOD_NS - 1.0).clip(0).sum()) for gap in gaps)
    yield f'{len(ARMS)} arms, results not heard', missed, '', 0
    yield (
        f'{len(ARMS)} arms, fewest sweeps estimated in a second',
        min(estimated) / (seconds + WARM_UP_S),
        '/ s',
        None,
    )
    yield f'{len(ARMS)} arms, processor time of bridges and estimators', share, '% of a core', 35


@contextmanager
def listening():
    """A function that listens for some seconds, and the stamps of the results heard of each topic, ns."""
    rclpy.init(args=[])
    node = rclpy.create_node('control')
    executor = EventsExecutor()
    executor.add_node(node)
    heard = {f'{arm}/pcc/{kind}': [] for arm in ARMS for kind in TOPICS}

    def take(stamps, data):
        stamps.append(read_stamp(data))

    for topic, stamps in heard.items():
        node.create_subscription(
            TOPICS[topic.rpartition('/')[2]], topic, partial(take, stamps), STREAM, raw=True
        )

    def hear(seconds):
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            executor.spin_once(timeout_sec=0.1)

    try:
        yield hear, heard
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()


def start(folder, name, *arguments):
    """A command of the package; what it prints goes to a file."""
    with (Path(folder) / name).open('wb') as out:
        command = [sys.executable, '-u', '-m', 'sesa2.cli', *map(str, arguments)]
        return subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT)


def used(process):
    """Processor time of a process with all its threads, s."""
    fields = Path(f'/proc/{process.pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) * _TICK_S


def main():
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seconds', type=float, default=60.0)
    for figure, value, unit, limit in rows(parser.parse_args().seconds):
        print(f'{figure}: {value:.3g} {unit}' + ('' if limit is None else f' (≤ {limit})'))


if __name__ == '__main__':
    main()
