"""What the firmware does, measured in simulated time: ``python test/firmware/figures.py [--json]``.

Needs the package on the path and what ``make -C firmware firmware simulator`` builds.
"""

import argparse
import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

from simulated_board import BUILD, CHANNELS, FIRMWARE, SimulatedBoard

from bench import Bench, Watched
from sesa2.link import board_client as link_board
from sesa2.link.packets import State
from sesa2.link.requests import FusionMode, Stream
from sesa2.sensing.imu.bno055.offsets import Offsets

OFFSETS = Offsets((1, 2, 3), (4, 5, 6), (7, 8, 9), 1000, 480)
FLASH_BYTES, RAM_BYTES = 253952, 8192  # of the ATmega2560, less the boot loader


@contextmanager
def streaming(**options: int) -> Iterator[Bench]:
    """Eight chips that stream."""
    with SimulatedBoard() as simulated, patch.object(link_board, 'time', simulated.clock()):
        bench = Bench(simulated)
        bench.boot()
        bench.start(**options)
        bench.wait(0.2)
        yield bench


def sizes() -> dict[str, float]:
    """Bytes of flash and RAM."""
    elf = BUILD / 'sesa2_firmware.elf'
    lines = subprocess.run(
        ['avr-size', '-A', elf], capture_output=True, text=True, check=True
    ).stdout.splitlines()
    section = {
        words[0]: int(words[1]) for line in lines if len(words := line.split()) == 3 and words[0][0] == '.'
    }
    return {
        'flash_bytes': section['.text'] + section['.data'],
        'ram_bytes': section['.data'] + section['.bss'],
    }


def sweeps() -> dict[str, float]:
    """Length of a sweep of eight, and how many there are in a second."""
    figures = {}
    for name, options in {
        '400_khz': {},
        '400_khz_with_acceleration': {'flags': Stream.QUATERNIONS | Stream.ACCELERATION},
        '400_khz_raw': {'mode': FusionMode.RAW},
        '400_khz_raw_with_magnetometer': {'mode': FusionMode.RAW, 'magnetometer': True},
        '100_khz': {'i2c_100khz': 1},
        '100_khz_raw': {'i2c_100khz': 1, 'mode': FusionMode.RAW},
    }.items():
        magnetometer = options.pop('magnetometer', False)
        with streaming(**options) as bench:
            if options.get('mode') is FusionMode.RAW:
                bench.client.stream(Stream.RAW | (Stream.MAGNETOMETER if magnetometer else 0))
                bench.packets.clear()
                bench.wait(2.0)
                data = bench.raw()
                figures[f'dropped_{name}'] = bench.client.stats().tx_dropped
            else:
                data = bench.watch(2.0)
            figures[f'sweep_ms_{name}'] = max(packet.sweep.scan_us for packet in data) / 1000
            figures[f'rate_hz_{name}'] = len(data) / 2.0
    return figures


def stretching() -> dict[str, float]:
    """How long all chips may stretch the clock at each read."""
    figures = {}
    with streaming() as bench:
        for stretch_us in range(100, 6000, 100):
            for channel in CHANNELS:
                bench.simulated.command('stretch', channel, stretch_us)
            bench.wait(0.2)
            data = bench.watch(1.0)
            if any(packet.state_of(channel) is not State.RUN for packet in data for channel in CHANNELS):
                break
            if len(data) >= 99:
                figures['stretch_us_at_100_hz'] = stretch_us
            if stretch_us in (300, 500, 1000):
                figures[f'rate_hz_stretched_{stretch_us}_us'] = len(data)
            figures['stretch_us_sustained'] = stretch_us
    return figures


def comebacks() -> dict[str, float]:
    """How soon a chip is missed, and how soon it is back; the longest of eight, at different moments of the sweep."""
    gone, back = [], []
    with streaming() as bench:
        for channel in CHANNELS:
            bench.client.write_offsets(channel + 1, OFFSETS)
        bench.wait(0.3)
        for channel in CHANNELS:
            bench.wait(0.1 + 0.00125 * channel)
            bench.simulated.command('unplug', channel)
            gone.append(bench.until(lambda data, k=channel: data.state_of(k) is State.ABSENT))
            bench.simulated.command('plug', channel)
            back.append(bench.until(lambda data, k=channel: data.state_of(k) is State.RUN))
    return {'unplug_to_absent_ms': 1000 * max(gone), 'replug_to_stream_s': max(back)}


def restarts() -> dict[str, float]:
    """From the first HELLO that a reset board answers until all chips stream with their offsets."""

    def all_run(data: Watched) -> bool:
        return all(data.state_of(channel) is State.RUN for channel in CHANNELS)

    with streaming() as bench:
        bench.simulated.command('reset')
        bench.client.hello()
        answered_us = bench.simulated.now_us
        for channel in CHANNELS:
            bench.client.write_offsets(channel + 1, OFFSETS)
        bench.start()
        return {'reset_to_stream_with_offsets_s': (bench.simulated.now_us - answered_us) * 1e-6}


def commands() -> dict[str, float]:
    """How long the commands take that go through CONFIG mode."""
    figures = {}
    with streaming() as bench:
        for name, command in {
            'write_offsets_ms': lambda: bench.client.write_offsets(3, OFFSETS),
            'read_offsets_ms': lambda: bench.client.read_offsets(3),
        }.items():
            bench.wait(0.2)
            start_us = bench.simulated.now_us
            command()
            figures[name] = (bench.simulated.now_us - start_us) / 1000
    return figures


def measure() -> dict[str, float]:
    """All figures by name."""
    figures = {}
    for part in (sizes, sweeps, stretching, comebacks, restarts, commands):
        figures |= part()
    return {name: round(value, 3) for name, value in figures.items()}


def main() -> int:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--json', action='store_true', help='one JSON object instead of a table')
    options = parser.parse_args()
    subprocess.run(
        ['make', '-s', '-C', FIRMWARE, 'firmware', 'simulator'], check=True, stdout=subprocess.DEVNULL
    )
    figures = measure()
    if options.json:
        print(json.dumps(figures))
        return 0
    for name, value in figures.items():
        limit = {'flash_bytes': FLASH_BYTES, 'ram_bytes': RAM_BYTES}.get(name)
        print(f'{name:34} {value:10g}' + (f'   {100 * value / limit:.1f} % of {limit}' if limit else ''))
    return 0


if __name__ == '__main__':
    sys.exit(main())
