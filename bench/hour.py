"""An hour of eight IMUs at 100 Hz, 2.9 million messages, replayed: how fast, and whether memory stays flat."""

import sys
import tempfile
from pathlib import Path

import numpy as np
from replay import timed

from sesa2.bags.writing import new_bag
from sesa2.link.virtual.motion import ArmMotion
from sesa2.messages.imu_messages import TYPE, ImuMessages

ROOT = Path(__file__).resolve().parents[1]
POSITIONS = 0.08 * np.arange(1, 9)
BLOCK_S = 10
PERIOD_NS, BETWEEN_IMUS_NS = 10_000_000, 550_000  # as the board reads them


def write_recording(path, seconds):
    """The arm of the virtual board, sample by sample in the order of reading."""
    motion = ArmMotion(POSITIONS)
    makers = [ImuMessages(f'imu_{i}') for i in range(1, 9)]
    with new_bag(path) as bag:
        topics = [bag.add_topic(f'/imu_{i}/data', TYPE) for i in range(1, 9)]
        for begin in range(0, seconds, BLOCK_S):
            first = (1_700_000_000 + begin) * 10**9
            rounds = first + PERIOD_NS * np.arange(100 * BLOCK_S)
            stamps = rounds[:, None] + BETWEEN_IMUS_NS * np.arange(8)
            q = motion((stamps - 1_700_000_000 * 10**9) * 1e-9)
            q = np.stack([q[:, i, i] for i in range(8)], axis=1)
            rows = [maker.make_many(stamps[:, i], q[:, i]) for i, maker in enumerate(makers)]
            for k in range(len(rounds)):
                for i, topic in enumerate(topics):
                    bag.write(topic, int(stamps[k, i]), rows[i][k].tobytes())


def rows(beside=None, seconds=3600):
    """(figure, value, unit, target); with another checkout `beside` this one, its figure too, measured in turn."""
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        write_recording(work / 'hour', seconds)
        write_recording(work / 'minute', 60)
        for name, root in {'': ROOT, f', {beside}': beside}.items() if beside else {'': ROOT}.items():
            memory = {}
            for recording in ('minute', 'hour'):
                command = [sys.executable, '-m', 'sesa2.cli', 'replay', work / recording, '--config']
                command += [ROOT / 'config/prototype3_8.yaml', '--out', work / f'{recording}{len(name)}']
                took, memory[recording] = timed(list(map(str, command)), root)
            yield f'replay of an hour, 8 × 100 Hz{name}', seconds / took, '× real time', '≥ 150'
            yield f'its memory{name}', memory['hour'], 'MB', f'one minute takes {memory["minute"]:.0f}'
