"""What hours do, in minutes: memory over millions of samples and a bag that loops, and recordings whose run is killed.

python bench/soak.py samples --hours 2      # as fast as the estimator takes them
python bench/soak.py loop --bag BAG --minutes 10 --rate 4
python bench/soak.py kills --times 60
"""

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

CONFIGURATION = Path(__file__).resolve().parents[1] / 'config/prototype3_8.yaml'
RATE = 100
NS = 10**9
TELL_EVERY = 10  # times in all


def resident_mb(pid='self'):
    """Memory of a process, MB."""
    return int(re.search(r'VmRSS:\s+(\d+)', Path(f'/proc/{pid}/status').read_text())[1]) / 1024


def samples(hours):
    """Feed the estimator, on a real graph, what eight IMUs measure in so many hours, as fast as it takes it."""
    from sesa2.configuration import files
    from sesa2.messages.imu_messages import ImuMessages
    from sesa2.nodes.estimator import EstimatorNode
    from sesa2.ros.hand_over import HandOver
    from sesa2.ros.parameters import overrides
    from sesa2.ros.spinning import Spinner, ros_context
    from sesa2.shape.rotations import from_rotation_vector

    c = files.load(CONFIGURATION)
    n, behind = round(hours * 3600 * RATE), 500
    bends = [from_rotation_vector([0.0, 0.5 * np.sin(0.1 * k), 0.0]).tolist() for k in range(63)]
    with ros_context([]), Spinner() as spinner:
        way = HandOver()
        node = EstimatorNode(way, parameter_overrides=overrides(c))
        spinner.add(node)
        makers = {i: (f'/imu_{i}/data', ImuMessages(f'imu_{i}')) for i in c.imus.ids}

        def feed():
            for k in range(n):
                while k - node.n_sweeps > behind:
                    time.sleep(0.002)
                now_ns, q = 1_700_000_000 * NS + k * NS // RATE, bends[k % len(bends)]
                way.send(
                    [(topic, maker.make(now_ns + i * 400_000, q)) for i, (topic, maker) in makers.items()]
                )

        threading.Thread(target=feed, daemon=True).start()
        told = 0
        while node.n_sweeps < n:
            spinner.spin_once()
            if node.n_sweeps >= told * n // TELL_EVERY:
                print(f'{node.n_sweeps} sweeps: {resident_mb():.1f} MB', flush=True)
                told += 1
        lost = n * len(makers) - sum(node.received.values())
        dropped = dict(node.assembler.dropped)
        print(
            f'{node.n_sweeps} of {n} sweeps, {lost} messages lost, dropped {dropped}: {resident_mb():.1f} MB'
        )


def run(folder, *arguments):
    """A `sesa2 run`; what it prints goes to a file."""
    command = [sys.executable, '-u', '-m', 'sesa2.cli', 'run', *map(str, arguments)]
    with (Path(folder) / 'out').open('wb') as out:
        return subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT)


def loop(bag, minutes, rate):
    """Play a bag again and again."""
    with tempfile.TemporaryDirectory() as folder:
        process = run(
            folder, '--config', CONFIGURATION, '--source', 'bag', '--bag', bag, '--loop', '--rate', rate
        )
        began = time.monotonic()
        for k in range(TELL_EVERY + 1):
            time.sleep(max(10.0, began + 60.0 * minutes * k / TELL_EVERY - time.monotonic()))
            print(
                f'{rate * (time.monotonic() - began):.0f} s of data: {resident_mb(process.pid):.1f} MB',
                flush=True,
            )
        process.send_signal(signal.SIGINT)
        process.wait()
        print((Path(folder) / 'out').read_text().splitlines()[-1])


def kills(times):
    """Kill recording runs at random moments; what is lost of each, s."""
    from sesa2.bags.recording import open_recording

    rng, lost, unreadable = np.random.default_rng(0), [], 0
    for k in range(times):
        with tempfile.TemporaryDirectory() as folder:
            bag = Path(folder) / 'bag'
            process = run(folder, '--config', CONFIGURATION, '--source', 'sim', '--record', bag)
            out = Path(folder) / 'out'
            while 'pcc tip' not in out.read_text():
                time.sleep(0.02)
            time.sleep(rng.uniform(0.5, 2.0))
            killed_ns = time.time_ns()
            process.kill()
            process.wait()
            try:
                with open_recording(bag) as recording:
                    last_ns = max(
                        message.log_ns for message in recording.messages(['/pcc/tip', '/imu_8/data'])
                    )
            except Exception as error:
                unreadable += 1
                print(f'kill {k + 1}: {error}')
                continue
            lost.append((killed_ns - last_ns) / NS)
    print(f'{times} kills: {unreadable} unreadable, lost {np.median(lost):.2f} s, at most {max(lost):.2f} s')


def main():
    """Do what is asked."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    what = parser.add_subparsers(dest='what', required=True)
    what.add_parser('samples').add_argument('--hours', type=float, default=2.0)
    what.add_parser('kills').add_argument('--times', type=int, default=60)
    looping = what.add_parser('loop')
    looping.add_argument('--bag', type=Path, required=True)
    looping.add_argument('--minutes', type=float, default=10.0)
    looping.add_argument('--rate', type=float, default=4.0)
    options = vars(parser.parse_args())
    {'samples': samples, 'loop': loop, 'kills': kills}[options.pop('what')](**options)


if __name__ == '__main__':
    main()
