"""The board's figures, from the real firmware in the simulated board, in simulated time."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
_SHOWN = {
    'sweep_ms_400_khz': ('sweep of 8 IMUs at 400 kHz, ms', '≤ 5'),
    'rate_hz_400_khz': ('rate at 400 kHz, Hz', '100'),
    'rate_hz_100_khz': ('rate at 100 kHz, Hz', ''),
    'stretch_us_at_100_hz': ('clock stretch on all chips that still leaves 100 Hz, µs', ''),
    'replug_to_stream_s': ('replug of an IMU to streaming with its offsets, s', ''),
    'flash_bytes': ('flash, bytes of 253952', ''),
    'ram_bytes': ('RAM, bytes of 8192', ''),
}


def rows():
    """(figure, value, limit)."""
    if not shutil.which('avr-gcc'):
        yield 'firmware', 'not measured', 'the packages that `make -C firmware needs` names are absent'
        return
    command = [sys.executable, str(ROOT / 'test/firmware/figures.py'), '--json']
    figures = json.loads(subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout)
    for key, (figure, limit) in _SHOWN.items():
        yield f'board: {figure}', str(figures[key]), limit
