"""firmware/PROTOCOL.md and the board's headers say what the package says."""

import re
import struct
from pathlib import Path

import pytest

from sesa2.link import framing, packets, requests
from sesa2.link.packets import State
from sesa2.link.requests import Command, FusionMode, Hello, Result, Stats, Stream
from sesa2.sensing.imu import addresses
from sesa2.sensing.imu.bno055.offsets import Offsets

FIRMWARE = Path(__file__).parents[2] / 'firmware'
PAGE = (FIRMWARE / 'PROTOCOL.md').read_text(encoding='utf-8')
FORMATS = {'u8': 'B', 'u16': 'H', 'u32': 'I', 'i16': 'h'}


def tables(section):
    """Tables of a section of the page, as lists of rows of cells without their heads."""
    text = PAGE.split(section, 1)[1]
    found = re.findall(r'(?:^\|.*\n)+', text, re.MULTILINE)
    return [
        [[cell.strip() for cell in re.split(r'(?<!\\)\|', line)[1:-1]] for line in table.splitlines()[2:]]
        for table in found
    ]


def enumerators(header):
    """Every name that an enum of a header gives a value, as the C compiler counts."""
    text = re.sub(r'/\*.*?\*/', '', (FIRMWARE / 'sesa2_firmware' / header).read_text(), flags=re.DOTALL)
    values = {}
    for body in re.findall(r'enum[\w\s:]*\{(.*?)\}', text, re.DOTALL):
        following = 0
        for item in filter(None, (item.strip() for item in body.split(','))):
            name, _, value = (part.strip() for part in item.partition('='))
            terms = [values[t] if t in values else int(t, 0) for t in re.findall(r'-?\w+', value)]
            values[name] = sum(terms) if terms else following
            following = values[name] + 1
    return values


def format_of(kinds):
    """The struct format of types as the page writes them: `u8`, `u8 ×8`."""
    parts = (re.fullmatch(r'(\w+)(?: ×(\d+))?', kind) for kind in kinds)
    return '<' + ''.join((part[2] or '') + FORMATS[part[1]] for part in parts)


def arguments_of(cell):
    """Bytes of arguments or fields as the page lists them: `u8 channel, 22 bytes`."""
    sizes = {'u8': 1, 'u16': 2, 'u32': 4}
    if cell == '–':
        return 0
    return sum(
        sizes[word[0]] if word[0] in sizes else int(word[0])
        for word in (item.split() for item in cell.split(','))
    )


PACKETS_H = enumerators('packets.h')
COMMANDS = tables('## PC → board')[0]
STATS = tables('STATS reply after result')[0]


@pytest.mark.parametrize(
    ('section', 'kind', 'type_'),
    [
        ('### DATA', 0, packets._DATA),
        ('### ACCELERATION', 0, packets._ACCELERATION),
        ('### RAW', 0, packets._RAW),
        ('### MAGNETOMETER', 0, packets._MAGNETOMETER),
    ],
)
def test_heads_of_stream_packets(section, kind, type_):
    rows = tables(section)[kind]
    head = rows[:6]
    assert [row[2] for row in head] == ['type', 'version', 'seq', 't_us', 'scan_us', 'mask']
    assert format_of(row[1] for row in head) == packets._HEAD.format
    at = 0
    for offset, wire, *_ in head:
        assert int(offset) == at
        at += struct.calcsize(format_of([wire]))
    assert int(rows[6][0]) == packets._HEAD.size == at
    assert [int(row[3]) for row in head[:2]] == [type_, packets.VERSION]


def test_entries_of_stream_packets():
    entries = tables('### DATA')[1]
    assert struct.calcsize(format_of(row[1] for row in entries)) == packets._ENTRY.itemsize
    assert tables('### DATA')[0][6][1] == f'{packets._ENTRY.itemsize} bytes per set bit, lowest first'
    for (offset, *_), name in zip(entries, ('health', 'calib', 'quaternion'), strict=True):
        assert int(offset) == packets._ENTRY.fields[name][1]
    states = re.findall(r'(\d) ([A-Z_]{3,})', entries[0][3])
    assert [(int(value), name) for value, name in states] == [(s.value, s.name) for s in State]
    assert tables('### ACCELERATION')[0][6][1] == 'i16 ×3 per set bit'
    assert tables('### MAGNETOMETER')[0][6][1] == 'i16 ×3 per set bit'


def test_entries_of_raw_packets():
    entries = tables('### RAW')[1]
    size = packets._RAW_ENTRY.itemsize
    assert struct.calcsize(format_of(row[1] for row in entries)) == size
    assert tables('### RAW')[0][6][1] == f'{size} bytes per set bit, lowest first'
    for (offset, *_), name in zip(entries, ('health', 'angular_velocity', 'acceleration'), strict=True):
        assert int(offset) == packets._RAW_ENTRY.fields[name][1]


def test_commands():
    assert [(int(row[0]), row[1]) for row in COMMANDS] == [(c.value, c.name) for c in Command]
    for row in COMMANDS:
        command = Command[row[1]]
        assert arguments_of(row[2]) == requests._ARGUMENT_BYTES[command], command.name
        if command is not Command.STATS:
            assert arguments_of(row[3]) == requests._FIELD_BYTES[command], command.name


def test_fields_of_replies_have_the_names_of_the_page():
    assert [item.split()[1] for item in COMMANDS[0][3].split(',')] == list(Hello._fields)
    assert [row[1] for row in STATS] == list(Stats._fields)
    assert format_of(row[0] for row in STATS) == requests._STATS.format
    assert [item.split()[1] for item in COMMANDS[1][2].split(',')] == list(
        requests.BoardConfiguration._fields
    )


def test_results_modes_and_flags():
    words = re.search(r'^result: (.*)$', PAGE, re.MULTILINE)[1].split(' · ')
    said = [(int(word.split(' ', 1)[0]), word.split(' ', 1)[1].upper().replace(' ', '_')) for word in words]
    assert said == [(result.value, result.name) for result in Result]
    modes = re.findall(r'(0x[0-9A-F]{2}) ([A-Z_]+)', COMMANDS[1][4])
    assert {name: int(value, 16) for value, name in modes} == {mode.name: mode.value for mode in FusionMode}
    flags = re.findall(r'(\d) (quaternions|acceleration|raw|magnetometer|stop)', COMMANDS[2][4])
    assert {name: int(value) for value, name in flags} == {
        'quaternions': Stream.QUATERNIONS,
        'acceleration': Stream.ACCELERATION,
        'raw': Stream.RAW,
        'magnetometer': Stream.MAGNETOMETER,
        'stop': Stream.STOP,
    }


def test_version_and_sizes():
    assert int(re.search(r'Protocol version \*\*(\d+)\*\*', PAGE)[1]) == packets.VERSION
    longest, frame = re.search(r'longest body is the (\d+) bytes .*?: (\d+) bytes on the line', PAGE).groups()
    assert int(longest) == framing.MAX_BODY == packets._HEAD.size + 8 * packets._RAW_ENTRY.itemsize
    assert int(frame) == framing.MAX_BODY + framing.FRAMING_BYTES
    assert len(Offsets((0,) * 3, (0,) * 3, (0,) * 3, 0, 0).to_registers()) == requests.OFFSET_BYTES


def test_the_boards_headers():
    expected = {
        'PROTOCOL_VERSION': packets.VERSION,
        'CHANNELS': addresses.CHANNELS,
        'OFFSETS_SIZE': requests.OFFSET_BYTES,
        'PACKET_DATA': packets._DATA,
        'PACKET_ACCELERATION': packets._ACCELERATION,
        'PACKET_RAW': packets._RAW,
        'PACKET_MAGNETOMETER': packets._MAGNETOMETER,
        'STREAM_QUATERNIONS': Stream.QUATERNIONS,
        'STREAM_ACCELERATION': Stream.ACCELERATION,
        'STREAM_RAW': Stream.RAW,
        'STREAM_MAGNETOMETER': Stream.MAGNETOMETER,
        'NO_QUATERNION': 0,
        'NO_VECTOR': packets._NOT_MEASURED,
        **{f'COMMAND_{command.name}': command.value for command in Command},
        **{f'RESULT_{result.name}': result.value for result in Result},
        **{f'STATE_{state.name}': state.value for state in State},
    }
    assert expected == PACKETS_H
    modes = {mode.name: mode.value for mode in FusionMode}
    assert enumerators('bno055.h') == {'CONFIG': 0, **modes}
    sizes = enumerators('framing.h')
    assert sizes['FRAMING_MAX_BODY'] == framing.MAX_BODY
    assert sizes['FRAMING_MAX_FRAME'] == framing.MAX_BODY + framing.FRAMING_BYTES
    config = (FIRMWARE / 'sesa2_firmware' / 'config.h').read_text()
    numbers = re.findall(r'#define FIRMWARE_(?:MAJOR|MINOR) (\d+)', config)
    assert tuple(map(int, numbers)) == requests.FIRMWARE
