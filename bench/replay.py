"""Offline replay of a 250 s trial of eight IMUs, start to end, and the memory that it takes."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from sesa2.configuration import files

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'test'))
from twin_recording import write_twin_recording  # noqa: E402  # the same recording as the tests'


def timed(arguments, root=ROOT):
    """Wall time, s, and peak memory, MB, of a command of the checkout `root`."""
    began = time.perf_counter()
    process = subprocess.Popen(arguments, stdout=subprocess.DEVNULL, cwd=root)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f'{arguments} failed')
    return time.perf_counter() - began, usage.ru_maxrss / 1024


def rows(data):
    """(figure, times real time, target); then the memory of a whole and of a tenth."""
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        write_twin_recording(data, work / 'whole')
        write_twin_recording(data, work / 'tenth', seconds=25.0)
        c = files.load(ROOT / 'config/prototype3_8.yaml')
        few, many = work / 'few.yaml', work / 'many.yaml'
        few.write_text(files.dump(c))
        many.write_text(files.dump(c.with_options('pcc', segments=(8,) * 8)))
        command = [sys.executable, '-m', 'sesa2.cli', 'replay']
        memory = {}
        for name, config, source, target in (
            ('rigid 8, pcc 17 links', few, 'whole', 60),
            ('rigid 8, pcc 65 links', many, 'whole', 30),
            ('a tenth of it', few, 'tenth', None),
        ):
            out = work / f'out {name}'
            took, memory[name] = timed(
                [*command, str(work / source), '--config', str(config), '--out', str(out)]
            )
            if target:
                yield f'replay, {name}', 250.0 / took, target
        yield (
            'replay, memory of 250 s against 25 s',
            memory['rigid 8, pcc 17 links'] / memory['a tenth of it'],
            None,
        )
