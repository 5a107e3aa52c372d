"""Offsets as other programs keep them; what they are is known from struct, not from our own writer."""

import json
import struct

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from sesa2.sensing.imu.bno055.foreign_offsets import ForeignOffsetsError, words_in_hex, words_of
from sesa2.sensing.imu.bno055.offsets import (
    Offsets,
    OffsetsError,
    load_offsets,
    read_chip_offsets,
    save_offsets,
)

WORDS = (-23, 5, -30, 120, -310, 42, -1, 0, 1, 1000, 712)
OFFSETS = Offsets(WORDS[0:3], WORDS[3:6], WORDS[6:9], 1000, 712)
DATA = struct.pack('<11h', *WORDS)
HEX = DATA.hex()

FILES = {
    'bare hex': HEX,
    'upper case, with an end of line': HEX.upper() + '\n',
    'blanks': DATA.hex(' '),
    'colons': DATA.hex(':'),
    'a C array': ['unsigned char c[22] ', ' {'][1] + ', '.join(f'0x{b:02X}' for b in DATA) + '};  // 0x55 on',
    'lines and comments': '# my chip\n' + '\n'.join(DATA[k : k + 6].hex(' ') for k in range(0, 22, 6)),
    'one 0x': '0x' + HEX,
    'words in hex': ' '.join(f'0x{w & 0xFFFF:04x}' for w in WORDS),
    'Python list of bytes': json.dumps(list(DATA)),
    'list of words': json.dumps(list(WORDS)),
    'list of unsigned words': json.dumps([w & 0xFFFF for w in WORDS]),
    'hex in JSON': json.dumps(HEX),
    'Arduino as JSON': json.dumps(
        {
            f'{s}_offset_{a}': WORDS[3 * i + k]
            for i, s in enumerate(('accel', 'mag', 'gyro'))
            for k, a in enumerate('xyz')
        }
        | {'accel_radius': 1000, 'mag_radius': 712}
    ),
    'Arduino printed': (
        'Accelerometer: -23 5 -30 \nGyro: -1 0 1 \nMag: 120 -310 42 \nAccel Radius: 1000\nMag Radius: 712\n'
    ),
    'CircuitPython': json.dumps(
        {
            'offsets_magnetometer': [120, -310, 42],
            'offsets_gyroscope': [-1, 0, 1],
            'offsets_accelerometer': [-23, 5, -30],
            'radius_magnetometer': 712,
            'radius_accelerometer': 1000,
        }
    ),
    'a ROS driver': yaml.safe_dump(
        {
            'bno055': {
                'ros__parameters': {
                    'uart_port': '/dev/ttyUSB0',
                    'acc_factor': 100.0,
                    'variance_acc': [0.017, 0.017, 0.017],
                    'set_offsets': True,
                    'offset_acc': [0xFFE9, 5, 0xFFE2],
                    'offset_mag': [120, 0xFECA, 42],
                    'offset_gyr': [0xFFFF, 0, 1],
                    'radius_acc': 1000,
                    'radius_mag': 712,
                }
            }
        }
    ),
    'nested': json.dumps(
        {
            'offsets': {
                'accel': {'x': -23, 'y': 5, 'z': -30},
                'gyro': {'x': -1, 'y': 0, 'z': 1},
                'mag': {'x': 120, 'y': -310, 'z': 42},
            },
            'radius': {'accel': 1000, 'mag': 712},
        }
    ),
    'Bosch': json.dumps(
        {
            'accel_offset': {'x': -23, 'y': 5, 'z': -30, 'r': 1000},
            'mag_offset': {'x': 120, 'y': -310, 'z': 42, 'r': 712},
            'gyro_offset': {'x': -1, 'y': 0, 'z': 1},
        }
    ),
    'camel case': json.dumps(
        {
            'accelOffset': [-23, 5, -30],
            'magOffset': [120, -310, 42],
            'gyroOffset': [-1, 0, 1],
            'accelRadius': '1000',
            'magRadius': '0x2C8',
        }
    ),
}


@pytest.mark.parametrize('kind', FILES)
def test_a_file_of_one_chip(kind, tmp_path):
    path = tmp_path / 'chip'
    path.write_text(FILES[kind])
    assert read_chip_offsets(path) == OFFSETS
    assert load_offsets(path, [7]).offsets == {7: OFFSETS}
    with pytest.raises(
        OffsetsError, match=r'one chip .*-23, 5, -30.* does not say of which IMU; `sesa2 offsets ID='
    ):
        load_offsets(path, [1, 2])
    with pytest.raises(OffsetsError, match='does not say of which IMU'):
        save_offsets(path, 1, OFFSETS)
    assert path.read_text() == FILES[kind]  # the only one that the user has


@given(st.lists(st.integers(-32768, 32767), min_size=11, max_size=11))
def test_words_come_back_from_every_form(words):
    data = struct.pack('<11h', *words)
    assert words_in_hex(data.hex()) == words
    assert words_in_hex(' '.join(f'0x{b:02x}' for b in data)) == words
    assert words_in_hex(','.join(f'0x{w & 0xFFFF:04X}' for w in words)) == words
    assert words_of([w & 0xFFFF for w in words]) == words
    assert words_of(list(data)) == words


@pytest.mark.parametrize(
    ('text', 'why'),
    [
        (HEX[:-2], '42 digits in hexadecimal, expected 44'),
        (HEX + '00', '46 digits in hexadecimal, expected 44'),
        (' '.join(f'{w & 0xFFFF:04x}' for w in WORDS), 'may be words or pairs of bytes'),
        (' '.join(['10'] * 22), 'hexadecimal or in decimal'),
        ('[1, 2, 3]', 'a list of 3, expected 22 bytes or 11 whole numbers'),
        ('{accel_offset_x: 1}', r'accel_offset\[y\], .*mag_radius missing'),
        (
            FILES['Arduino as JSON'].replace('712', '70000'),
            'mag_radius: expected a whole number .* got 70000',
        ),
        (
            FILES['Arduino as JSON'].replace('712', '71.5'),
            r'mag_radius: expected a whole number .* got 71\.5',
        ),
        (FILES['Arduino as JSON'].replace('}', ', "radius_mag": 713}'), 'mag_radius stands there twice'),
        ('{"host": "lab"}', 'no offsets of a BNO055 in it'),
    ],
)
def test_what_is_no_such_file_is_explained(text, why, tmp_path):
    path = tmp_path / 'chip'
    path.write_text(text)
    with pytest.raises(OffsetsError, match=why):
        read_chip_offsets(path)


def test_entries_of_a_calibration_file_may_be_as_other_programs_have_them(tmp_path):
    path = tmp_path / 'offsets.yaml'
    path.write_text(
        yaml.safe_dump({'imus': {1: json.loads(FILES['CircuitPython']), 2: json.loads(FILES['nested'])}})
    )
    assert load_offsets(path, [1, 2]).offsets == {1: OFFSETS, 2: OFFSETS}


def test_no_offsets_in_nothing():
    assert words_in_hex('') is None
    for nothing in ({}, None, 5, 'text'):
        with pytest.raises(ForeignOffsetsError):
            words_of(nothing)


def test_the_cases(cases):
    folder = cases / '18-bno055-offset-files'
    assert read_chip_offsets(folder / 'adafruit.json') == OFFSETS
    assert read_chip_offsets(folder / 'registers.txt') == OFFSETS
    (unsigned,) = load_offsets(folder / 'unsigned.yaml', [1]).offsets.values()
    assert unsigned == Offsets((-20, 165, -24), (-76, -354, 637), (2, -1, -1), 1000, 480)
