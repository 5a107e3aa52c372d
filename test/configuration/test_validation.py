"""Every mistake is found at once, with its place and what is allowed."""

import math
import os
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from sesa2.configuration import ConfigurationError, files, validate
from sesa2.configuration.description import describe
from sesa2.configuration.records import leaves

CONFIG = Path(__file__).parents[2] / 'config'
RIGHT_NAME = 'letters, digits and _ between single slashes, as /left/imu_3/data'
RIGHT_PREFIX = 'letters, digits, _ and /, first a letter, as left_'
SHIPPED = sorted(CONFIG.glob('*.yaml'))


def values(**changes):
    """A small valid configuration; `section__key=value` changes it, `section__key=None` takes the key away."""
    base = {
        'arm': {'length': 0.3},
        'imus': {'ids': [2, 5], 'positions': [0.1, 0.3]},
        'markers': {'names': ['A', 'B'], 'positions': [0.1, 0.2]},
    }
    for path, value in changes.items():
        section, _, key = path.partition('__')
        target = base.setdefault(section, {}) if key else base
        key = key or section
        if value is None:
            target.pop(key)
        else:
            target[key] = value
    return base


def mistakes(**changes):
    with pytest.raises(ConfigurationError) as caught:
        validate(values(**changes))
    return [f'{m.place}: {m.message}' for m in caught.value.mistakes]


def test_defaults_are_filled_in_per_imu():
    c = validate(values())
    assert c.imus.enabled == (True, True)
    assert c.options['pcc'].segments == (2, 2)
    assert c.mountings.shape == (2, 4)
    assert c.headings.tolist() == [0.0, 0.0]
    assert c.frame_id == 'base_link'


@pytest.mark.parametrize('name', ['a', '/a', 'imu3/data', '/left/imu_3/data', '/_x/y_', 'A/b2/c_3'])
def test_names_of_topics_as_ros_takes_them(name):
    rclpy_names = pytest.importorskip('rclpy.validate_topic_name', reason='ROS is not installed')
    assert rclpy_names.validate_topic_name(name)
    assert validate(values(imus__topics=[name, '/other'])).imus.topics == (name, '/other')


@pytest.mark.parametrize('prefix', ['', 'left_', 'lab/left/', 'a'])
def test_frames_with_a_prefix(prefix):
    assert validate(values(arm__frame_prefix=prefix)).frame_id == f'{prefix}base_link'
    assert validate(values(arm__frame_prefix=prefix, arm__output_frame='world')).frame_id == f'{prefix}world'


@pytest.mark.parametrize(
    ('changes', 'expected'),
    [
        ({'imus__topics': ['/a/data']}, 'imus.topics: has 1 entries, expected 2: one per id'),
        (
            {'imus__topics': ['/a/data', '/b/data'], 'imus__base_id': 1},
            'imus.topics: has 2 entries, expected 3: one per id, and one for imus.base_id',
        ),
        ({'imus__topics': ['/a', '/a']}, "imus.topics[1]: got '/a' a second time"),
        *(
            (
                {'imus__topics': ['/a', bad]},
                f'imus.topics[1]: got {bad!r}, expected the name of a topic: {RIGHT_NAME}',
            )
            for bad in ('', '/', 'a b', '/a/', 'a//b', '3a', '~/a', '/a/{node}', 'a-b', '/ä')
        ),
        *(
            (
                {'arm__frame_prefix': bad},
                f'arm.frame_prefix: got {bad!r}, expected nothing, or {RIGHT_PREFIX}',
            )
            for bad in ('/left_', ' left', 'left ', '3_', 'a-')
        ),
        ({'arm__lenght': 1.0}, 'arm.lenght: is not known; did you mean arm.length?'),
        ({'radius': 0.1}, 'radius: is not known; did you mean arm.radius?'),
        ({'xyzzy': 1}, 'xyzzy: is not known'),
        ({'arm': 3}, 'arm: got 3, expected a section with keys'),
        ({'arm__length': None}, 'arm.length: is missing'),
        ({'arm__length': 'long'}, "arm.length: got 'long', expected a number"),
        ({'arm__length': True}, 'arm.length: got True, expected a number'),
        ({'arm__length': math.nan}, 'arm.length: got nan, expected a finite number'),
        ({'arm__length': -1.0}, 'arm.length: got -1.0, expected more than 0'),
        (
            {'arm__output_frame': 'bas'},
            "arm.output_frame: got 'bas', expected one of base, world; did you mean base?",
        ),
        (
            {'arm__base_orientation': [0.0, 0.0, 1.0]},
            'arm.base_orientation: has 3 numbers, expected 4: x y z w',
        ),
        (
            {'arm__base_orientation': [0.0, 0.0, 0.0, 0.0]},
            'arm.base_orientation: has norm 0, expected a unit quaternion x y z w',
        ),
        (
            {'imus__positions': [0.0, 0, 0.3]},
            'imus.positions[1]: got the integer 0 among numbers, which ROS cannot read; write 0.0',
        ),
        (
            {'imus__positions': []},
            'imus.positions: got an empty list, which ROS cannot read; leave the key out',
        ),
        ({'imus__positions': 0.1}, 'imus.positions: got 0.1, expected a list, [a number, …]'),
        ({'imus__positions': [0.3, 0.1]}, 'imus.positions[1]: 0.1 m is not after 0.3 m'),
        ({'imus__positions': [0.1, 0.4]}, 'imus.positions[1]: 0.4 m is beyond the tip at 0.3 m'),
        ({'imus__positions': [0.1]}, 'imus.positions: has 1 entries, expected 2: one per id'),
        ({'imus__ids': [2, 2]}, 'imus.ids[1]: got 2 a second time'),
        (
            {'imus__ids': [2, 9]},
            'imus.ids[1]: got 9, expected 1 to 8: 8 on each board, and serial.ports says where several are',
        ),
        (
            {'imus__ids': [2, 17], 'serial__ports': ['/dev/a', '/dev/b']},
            'imus.ids[1]: got 17, expected 1 to 16: 8 on each board, and serial.ports says where several are',
        ),
        (
            {'imus__base_id': 9},
            'imus.base_id: got 9, expected 1 to 8: 8 on each board, and serial.ports says where several are',
        ),
        ({'imus__ids': [0, 2]}, 'imus.ids[0]: got 0, expected at least 1'),
        (
            {'serial__ports': ['/dev/a', '/dev/b']},
            'serial.ports[1]: has no IMU, expected one of the ids 9 to 16 in imus.ids',
        ),
        (
            {'serial__ports': ['/dev/a', '/dev/a'], 'imus__ids': [2, 9]},
            "serial.ports[1]: got '/dev/a' a second time",
        ),
        (
            {'serial__ports': ['/dev/a', '/dev/b'], 'serial__port': '/dev/c', 'imus__ids': [2, 9]},
            'serial.port: stands beside serial.ports, expected one of the two: port for one board, ports for several',
        ),
        (
            {'serial': {'port': ''}, 'run': {'source': 'serial'}},
            'serial.port: is empty, expected a serial port',
        ),
        ({'imus__ids': [2, 5.0]}, 'imus.ids[1]: got 5.0, expected an integer'),
        (
            {'imus__enabled': [False, False]},
            'imus.enabled: got false for every IMU, expected at least one true',
        ),
        ({'imus__enabled': [True]}, 'imus.enabled: has 1 entries, expected 2: one per id'),
        (
            {'imus__headings': [0.0] * 3},
            'imus.headings: has 3 entries, expected 1 or 2: one for all or one per IMU',
        ),
        (
            {'imus__mount_orientations': [0.0] * 5},
            'imus.mount_orientations: has 5 numbers, expected 4 or 8: x y z w, one for all or one per IMU',
        ),
        (
            {'imus__mount_orientations': [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.5, 0.5]},
            'imus.mount_orientations[4:8]: has norm 0.7071, expected a unit quaternion x y z w',
        ),
        ({'imus__base_id': 5}, 'imus.base_id: got 5, which is also in imus.ids; it sits on the base'),
        ({'markers__names': ['A', 'A']}, "markers.names[1]: got 'A' a second time"),
        ({'markers__names': ['A', 3]}, 'markers.names[1]: got 3, expected a text (quote it)'),
        ({'markers__positions': [0.1, 0.31]}, 'markers.positions[1]: 0.31 m is beyond the tip at 0.3 m'),
        ({'markers__positions': [0.1]}, 'markers.positions: has 1 entries, expected 2: one per name'),
        ({'models': ['pcx']}, "models[0]: got 'pcx', expected one of"),
        ({'models': ['pcc', 'pcc']}, "models[1]: got 'pcc' a second time"),
        ({'pcc__segments': [2]}, 'pcc: segments has 1 entries, expected 2'),
        ({'pcc__segments': [2, 0]}, 'pcc.segments[1]: got 0, expected 1 to 1000'),
        (
            {'rigid__boundaries': 'mid'},
            "rigid: boundaries = 'mid', expected 'midpoint', 'endpoint' or a list",
        ),
        ({'rigid__boundaries': [0.1, 0.2]}, 'rigid: boundaries has 2 entries, expected 1'),
        ({'run__source': 'bag'}, "run.bag: is empty, and the source is 'bag'"),
        ({'run__mode': 'calibrate'}, "calibration.file: is empty, and the mode is 'calibrate'"),
        (
            {'serial__fusion': 'RAW'},
            "serial.fusion: got 'RAW', which gives no orientations by itself, expected imus.fusion 6d or 9d",
        ),
        (
            {'imus__fusion': '9d', 'run__source': 'serial'},
            "imus.fusion: got '9d', and the chips fuse by themselves (serial.fusion: NDOF)",
        ),
        ({'serial__rate_hz': 200}, 'serial.rate_hz: got 200, expected 1 to 100'),
    ],
)
def test_a_mistake_is_named(changes, expected):
    found = mistakes(**changes)
    assert any(m.startswith(expected) for m in found), found


def test_all_mistakes_come_at_once():
    found = mistakes(arm__lenght=1.0, imus__ids=[1, 0], models=['x'], sweep_timeout=0.0)
    assert len(found) == 4


@pytest.mark.parametrize('path', SHIPPED, ids=lambda p: p.stem)
def test_shipped_configurations_are_valid_and_survive_the_file(path):
    c = files.load(path)
    assert files.parse(files.dump(c), 'dump') == c
    assert files.find(path.stem) == path


def test_the_dump_has_numbers_that_ros_reads_as_numbers():
    c = validate(values(sweep_timeout=1e-5, arm__base_orientation=[1e-20, 0.0, 0.0, 1.0]))
    dumped = files.dump(c)
    assert files.parse(dumped, 'dump') == c
    plain = yaml.safe_load(dumped)['/**']['ros__parameters']
    assert type(plain['sweep_timeout']) is float
    assert {type(v) for v in plain['arm']['base_orientation']} == {float}


def test_every_parameter_says_what_it_means():
    paths = [path for path, _, _ in leaves()]
    assert len(paths) == len(set(paths)) > 30
    assert all(len(item.metadata['meaning']) > 5 for _, _, item in leaves())
    assert set(validate(values()).flat()) == set(paths)


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('a: [1, 2', 'line 1, column 9: YAML: expected'),
        ('/**:\n  ros__parameters:\n    arm: {length: 1.0}\n    arm: {length: 2.0}\n', 'line 4'),
        ('', "got NoneType, expected '/**:'"),
        ('- 1', "got list, expected '/**:'"),
        ('arm: {length: 1.0}', 'arm: is not read'),
        ('/**: {parameters: {}}', "expected '/**:' and under it 'ros__parameters:'"),
        ('/estimator:\n  ros__parameters: {}', '/estimator: is not read'),
    ],
)
def test_a_file_that_is_none_is_explained(text, expected, tmp_path):
    path = tmp_path / 'arm.yaml'
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=r'arm\.yaml') as caught:
        files.load(path)
    assert expected in str(caught.value)


def test_a_missing_file_lists_the_shipped_ones(tmp_path):
    with pytest.raises(ConfigurationError, match=r'no such file.*prototype3_8'):
        files.find('prototype9')
    with pytest.raises(ConfigurationError, match='is a folder'):
        files.find(str(tmp_path))
    with pytest.raises(ConfigurationError, match='is a folder, expected a file'):
        files.load(tmp_path)
    for name, expected in (
        ('x' * 5000, 'cannot be read: File name too long'),
        ('a\0b', 'cannot be read: .*embedded null'),
        ('\udcff', 'no such file'),
    ):
        with pytest.raises(ConfigurationError, match=expected) as caught:
            files.find(name)
        assert len(str(caught.value)) < 400


def test_what_would_never_end_is_not_read(tmp_path):
    os.mkfifo(tmp_path / 'pipe.yaml')
    (tmp_path / 'loop.yaml').symlink_to('loop.yaml')
    for name, expected in (
        ('pipe', 'is a pipe, expected a file'),
        ('loop', 'Too many levels of symbolic links'),
    ):
        path = tmp_path / f'{name}.yaml'
        with pytest.raises(ConfigurationError, match=expected):
            files.load(files.find(str(path)))


VALUES = [
    '{{ LENGTH }}', '{? [1, 2] : 3}', '2024-02-31', '2024-02-29', '!!int x', '9' * 5000, '9' * 99, '1e999', '.nan',
    '[' * 10_000, '"\\ud800"', '"\\0"', f'"{"x" * 100_000}"', f'{{{"x" * 100_000}: 1}}', '!!set {a, b}',
    '!!binary aGVsbG8=', '[.inf, 1, x, [[[[[[[1]]]]]]]]', '&a [*a]', '!!omap [{a: 1}]', '{1: 2, null: 3}',
    '[' + '&b [&c [&d [1,2,3],*d,*d,*d,*d,*d],*c,*c,*c,*c,*c,*c],*b,*b,*b,*b,*b,*b' + ']',
    '[' + 'x, ' * 9000 + ']', '{' + ', '.join(f'key{i}: 1' for i in range(4900)) + '}',
]  # fmt: skip

PLACES = [
    'arm',
    'arm.length',
    'imus.ids',
    'imus.positions',
    'markers.names',
    'rigid.boundaries',
    'models',
    'x',
]


@pytest.mark.parametrize('value', VALUES, ids=range(len(VALUES)))
@pytest.mark.parametrize('place', PLACES)
def test_a_strange_value_is_a_mistake_told_in_a_few_lines(place, value):
    section, _, key = place.partition('.')
    inner = f'{{{key}: {value}}}' if key else value
    with pytest.raises(ConfigurationError) as caught:
        files.parse(f'/**:\n  ros__parameters:\n    {section}: {inner}\n', 'a test')
    assert len(str(caught.value)) < 15_000
    str(caught.value).encode()


@given(
    st.dictionaries(
        st.sampled_from(['arm', 'imus', 'models', 'links', 'run', 'serial', 'x', 'sweep_timeout'])
        | st.text(),
        st.recursive(
            st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.dates() | st.binary(),
            lambda inner: (
                st.lists(inner)
                | st.dictionaries(st.sampled_from(['length', 'ids', 'positions', 'port', 'bag']), inner)
            ),
        ),
    )
)
def test_any_values_give_a_configuration_or_the_error(given_values):
    try:
        validate({'arm': {'length': 0.3}, 'imus': {'ids': [1], 'positions': [0.1]}, **given_values})
    except ConfigurationError as error:
        str(error).encode()


def test_mountings_are_normalised():
    c = validate(values(imus__mount_orientations=[0.0, 0.0, 0.0, 1.0, 0.71, 0.0, 0.0, 0.71]))
    np.testing.assert_allclose(c.mountings, [[0, 0, 0, 1], [0.5**0.5, 0, 0, 0.5**0.5]])


def test_ids_have_no_end_where_no_board_is_asked(tmp_path):
    for run in ({'source': 'external'}, {'source': 'bag', 'bag': 'some'}):
        c = validate(values(imus__ids=[300, 9], imus__base_id=1000, run=run))
        assert c.imus.all_ids == (300, 9, 1000)
        assert 'channel' not in describe(c)


def test_ports_of_several_boards_stand_in_place_of_the_one(tmp_path):
    c = validate(values(imus__ids=[12, 5], serial__ports=['/dev/a', '/dev/b']))
    assert c.serial.port == ''
    assert c.serial.all_ports == ('/dev/a', '/dev/b')
    assert files.parse(files.dump(c), 'again') == c
    lines = [line.split()[:3] for line in describe(c).splitlines()]
    assert ['id', 'port', 'channel'] in lines
    assert ['12', '/dev/b', '3'] in lines
    assert ['5', '/dev/a', '4'] in lines
    assert c.serial.on(['/dev/x']).all_ports == ('/dev/x',)
    assert c.serial.on(['/dev/x', '/dev/y']).all_ports == ('/dev/x', '/dev/y')
    assert validate(values()).serial.all_ports == ('/dev/ttyACM0',)
