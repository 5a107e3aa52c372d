"""Four arms of eight IMUs at 100 Hz, each a `sesa2 run` in its namespace: what they cost, and whether a sweep is lost.

The virtual boards are processes apart, whose time is not counted; so is what this file itself takes.
"""

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ARMS = ('left', 'right', 'front', 'back')
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
            time.sleep(WARM_UP_S)
            before, began = [used(run) for run in runs], time.monotonic()
            time.sleep(seconds)
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
    yield (
        f'{len(ARMS)} arms, fewest sweeps estimated in a second',
        min(estimated) / (seconds + WARM_UP_S),
        '/ s',
        None,
    )
    yield f'{len(ARMS)} arms, processor time of bridges and estimators', share, '% of a core', 35


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
