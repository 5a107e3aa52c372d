import errno
import os
import resource
import signal
import stat
import subprocess
import tempfile
from datetime import datetime, timezone
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from processes import Program

from sesa2.sensing.imu.accelerometer_calibration import AccelerometerCalibration
from sesa2.sensing.imu.bno055.offsets import (
    Offsets,
    OffsetsError,
    load_accelerometers,
    load_offsets,
    save_accelerometer,
    save_offsets,
)

OFFSETS = Offsets((1, -2, 3), (-256, 255, 0), (0, -1, 32767), 1000, -32768)
SAVED_AT = datetime(2024, 5, 6, 7, 8, 9, tzinfo=timezone.utc)
FILE = """\
imus:
  1:
    accel_offset: [1, -2, 3]
    mag_offset: [-256, 255, 0]
    gyro_offset: [0, -1, 32767]
    accel_radius: 1000
    mag_radius: -32768
    saved_at: 2024-05-06T07:08:09+00:00
  5:
    note: by hand
    accel_offset: [0, 0, 0]
arm: left
"""


@pytest.fixture
def path(tmp_path):
    path = tmp_path / 'calibration.yaml'
    path.write_text(FILE)
    return path


def test_golden_registers():
    registers = '0100 feff 0300  00ff ff00 0000  0000 ffff ff7f  e803 0080'
    assert OFFSETS.to_registers() == bytes.fromhex(registers)
    assert Offsets.from_registers(bytes.fromhex(registers)) == OFFSETS


@given(st.binary(min_size=22, max_size=22))
def test_registers_come_back(registers):
    assert Offsets.from_registers(registers).to_registers() == registers


def test_load(path):
    calibration = load_offsets(path, [1])
    assert calibration.offsets == {1: OFFSETS}
    assert calibration.missing == ()


def test_an_imu_that_is_not_in_the_file_is_reported(path):
    calibration = load_offsets(path, [3, 1, 2])
    assert calibration.offsets == {1: OFFSETS}
    assert calibration.missing == (3, 2)


def test_save_makes_a_file(tmp_path):
    path = tmp_path / 'new.yaml'
    save_offsets(path, 7, OFFSETS, SAVED_AT)
    assert load_offsets(path, [7]).offsets == {7: OFFSETS}
    assert yaml.safe_load(path.read_text()) == {
        'imus': {
            7: {
                'accel_offset': [1, -2, 3],
                'mag_offset': [-256, 255, 0],
                'gyro_offset': [0, -1, 32767],
                'accel_radius': 1000,
                'mag_radius': -32768,
                'saved_at': '2024-05-06T07:08:09+00:00',
            }
        }
    }


def test_saved_at_is_now_by_default(tmp_path):
    before = datetime.now(timezone.utc).replace(microsecond=0)
    save_offsets(tmp_path / 'new.yaml', 7, OFFSETS)
    saved_at = yaml.safe_load((tmp_path / 'new.yaml').read_text())['imus'][7]['saved_at']
    assert before <= datetime.fromisoformat(saved_at) <= datetime.now(timezone.utc)


def test_save_touches_nothing_else(path):
    before = yaml.safe_load(FILE)
    save_offsets(path, 2, OFFSETS, SAVED_AT)
    after = yaml.safe_load(path.read_text())
    assert after['imus'].pop(2)
    assert after == before  # IMU 5 too, which is not complete


def test_save_replaces_an_entry(path):
    other = Offsets((9, 9, 9), (8, 8, 8), (7, 7, 7), 6, 5)
    save_offsets(path, 1, other, SAVED_AT)
    assert load_offsets(path, [1]).offsets == {1: other}


def test_save_keeps_mode_and_symbolic_link(path, tmp_path):
    path.chmod(0o640)
    link = tmp_path / 'link.yaml'
    link.symlink_to(path)
    save_offsets(link, 2, OFFSETS)
    assert link.is_symlink()
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert 2 in load_offsets(path, [2]).offsets


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        ('    mag_radius: -32768\n', '', r'imus\.1: key mag_radius is missing'),
        (
            '[1, -2, 3]',
            '[1, -2, 70000]',
            r'imus\.1\.accel_offset\[2\]: expected .* -32768 to 32767, .* got 70000',
        ),
        ('-32768', '-32769', r'imus\.1\.mag_radius: expected .* got -32769'),
        ('[1, -2, 3]', '[1, -2]', r'imus\.1\.accel_offset: expected a list of 3 .* got \[1, -2\]'),
        ('[1, -2, 3]', '7', r'imus\.1\.accel_offset: expected a list of 3 .* got 7'),
        ('1000', '1000.0', r'imus\.1\.accel_radius: expected a whole number .* got 1000\.0'),
        ('1000', 'true', r'imus\.1\.accel_radius: expected a whole number .* got True'),
        ('  1:', '  one:', r'imus\.one: an IMU is named by its id'),
        ('  5:', '  1:', r'line 9, column 3: the key 1 stands here a second time'),
        ('[1, -2, 3]', '[1, -2, 3', r'line 4, column 15'),
        (FILE, 'imus: [1, 2]', 'expected a mapping'),
        (FILE, '', 'expected a mapping'),
        (FILE, 'imus: {1: 5}', r'imus\.1: expected a mapping of offsets, got 5'),
        (FILE, '? {a: b}\n: c', r'line 1, column 3: a mapping as a key'),
    ],
)
def test_a_bad_file_is_explained_with_its_place(path, old, new, message):
    assert old in FILE
    path.write_text(FILE.replace(old, new, 1))
    with pytest.raises(OffsetsError, match=message) as caught:
        load_offsets(path, [1])
    assert str(path) in str(caught.value)


@pytest.mark.parametrize('content', ['imus: [', 'configuration: of something else\n', 'imus: {a: 1}'])
def test_what_is_no_calibration_file_is_not_overwritten(path, content):
    path.write_text(content)
    with pytest.raises(OffsetsError):
        save_offsets(path, 1, OFFSETS)
    assert path.read_text() == content


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(OffsetsError, match=r'nowhere\.yaml: cannot be read: No such file'):
        load_offsets(tmp_path / 'nowhere.yaml', [1])
    with pytest.raises(OffsetsError, match='offsets of IMU 1 not saved: No such file'):
        save_offsets(tmp_path / 'nowhere' / 'new.yaml', 1, OFFSETS)


def test_a_directory_or_bytes_that_are_no_text(tmp_path):
    with pytest.raises(OffsetsError, match='is a folder, expected a file'):
        load_offsets(tmp_path, [1])
    (tmp_path / 'binary').write_bytes(b'\xff\xfe\x00\x01\x02')
    with pytest.raises(OffsetsError, match='binary'):
        load_offsets(tmp_path / 'binary', [1])


def test_a_write_that_the_system_refuses_leaves_the_old_file(path):
    """A real one: the limit on the size of files."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, hard))
    try:
        with pytest.raises(OffsetsError, match='offsets of IMU 2 not saved: File too large'):
            save_offsets(path, 2, OFFSETS)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert path.read_text() == FILE
    assert list(path.parent.iterdir()) == [path]


def test_a_full_disk_leaves_the_old_file(path, monkeypatch):
    def full(_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, 'fsync', full)
    with pytest.raises(OffsetsError, match='not saved: No space left on device'):
        save_offsets(path, 2, OFFSETS)
    assert path.read_text() == FILE
    assert list(path.parent.iterdir()) == [path]


def test_content_is_on_the_disk_before_the_rename_and_the_rename_before_the_end(path, monkeypatch):
    steps = []
    fsync, replace = os.fsync, Path.replace

    def noted_fsync(descriptor):
        steps.append('directory' if stat.S_ISDIR(os.fstat(descriptor).st_mode) else 'file')
        fsync(descriptor)

    def noted_replace(self, target):
        steps.append('rename')
        return replace(self, target)

    monkeypatch.setattr(os, 'fsync', noted_fsync)
    monkeypatch.setattr(Path, 'replace', noted_replace)
    save_offsets(path, 2, OFFSETS)
    assert steps == ['file', 'rename', 'directory']


@pytest.mark.parametrize('umask', [0o022, 0o077, 0o002])
def test_a_new_file_keeps_the_umask(tmp_path, umask):
    before = os.umask(umask)
    try:
        save_offsets(tmp_path / 'new.yaml', 1, OFFSETS)
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / 'new.yaml').stat().st_mode) == 0o666 & ~umask


SAVER = """
import os, sys
from sesa2.sensing.imu.bno055 import offsets
def stop(descriptor):
    print('half', flush=True)
    sys.stdin.read()
os.fsync = stop
offsets.save_offsets(sys.argv[1], 1, offsets.Offsets((0,) * 3, (0,) * 3, (0,) * 3, 0, 0))
"""


def test_a_save_that_was_killed_is_swept_by_the_next(path, tmp_path_factory):
    output = tmp_path_factory.mktemp('output')
    with Program(['-c', SAVER, path], output, stdin=subprocess.PIPE) as program:
        program.until(lambda: 'half' in program.output, 'half a save')
        save_offsets(path, 1, OFFSETS)
        assert len(list(path.parent.iterdir())) == 2  # it is somebody's
        program.signal(signal.SIGKILL)
        program.ended()
    save_offsets(path, 2, OFFSETS)
    assert list(path.parent.iterdir()) == [path]
    assert load_offsets(path, [1, 2]).offsets == {1: OFFSETS, 2: OFFSETS}


def test_what_would_never_end_is_neither_read_nor_replaced(tmp_path):
    os.mkfifo(tmp_path / 'pipe')
    (tmp_path / 'loop').symlink_to('loop')
    (tmp_path / 'long').symlink_to('x' * 300)
    for name, expected in (
        ('pipe', 'is a pipe, expected a file'),
        ('loop', 'Too many levels of symbolic links'),
        ('long', 'File name too long'),
        ('.', 'is a folder, expected a file'),
        ('a\0b', 'null'),
    ):
        path = tmp_path / name
        for action in (lambda: load_offsets(path, [1]), lambda: save_offsets(path, 1, OFFSETS)):  # noqa: B023
            with pytest.raises(OffsetsError, match=expected):
                action()
    assert {p.name for p in tmp_path.iterdir()} == {'pipe', 'loop', 'long'}
    assert (tmp_path / 'loop').is_symlink()


@given(st.one_of(st.binary(), st.text(alphabet='imus: {}[]\n1&*a"!').map(str.encode)))
def test_any_file_gives_offsets_or_the_error(content):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'offsets.yaml'
        path.write_bytes(content)
        try:
            load_offsets(path, [1])
        except OffsetsError as error:
            message = str(error)
        else:
            message = ''
        assert len(message) < 1000


# The accelerometer's own calibration, beside them

CALIBRATION = AccelerometerCalibration(
    (0.1, -0.2, 0.3), ((1.01, 0.002, -0.003), (0.004, 0.99, 0.005), (-0.006, 0.007, 1.02))
)


def test_an_accelerometers_calibration_is_kept_beside_the_offsets(tmp_path):
    path = tmp_path / 'offsets.yaml'
    save_offsets(path, 3, OFFSETS)
    save_accelerometer(path, 3, CALIBRATION)
    save_accelerometer(path, 4, CALIBRATION)
    save_offsets(path, 3, OFFSETS)
    assert load_accelerometers(path, (1, 3, 4)) == {3: CALIBRATION, 4: CALIBRATION}
    assert load_offsets(path, (3, 4)) == ({3: OFFSETS}, (4,))
    save_offsets(path, 4, OFFSETS)
    assert load_accelerometers(path, (4,)) == {4: CALIBRATION}
    assert load_offsets(path, (4,)).offsets == {4: OFFSETS}


@pytest.mark.parametrize(
    ('entry', 'message'),
    [
        ('7', r'imus\.3\.accelerometer: expected a mapping'),
        ('{bias: [0.0, 0.0, 0.0]}', r'imus\.3\.accelerometer: expected a mapping'),
        (
            '{bias: [0.0, 0.0], matrix: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}',
            r'accelerometer\.bias: expected a list of 3',
        ),
        (
            '{bias: [0, 0, 0], matrix: [[1, 0, 0], [0, 1], [0, 0, 1]]}',
            r'accelerometer\.matrix\[1\]: expected a list',
        ),
        ('{bias: [0, 0, 0], matrix: 1}', r'accelerometer\.matrix\[0\]: expected a list'),
        ('{bias: [0, 0, 0], matrix: [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}', 'accelerometer: matrix .* mirrors'),
        ('{bias: [0, 0, .nan], matrix: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}', 'accelerometer: expected 3'),
    ],
)
def test_an_accelerometers_calibration_that_is_none(tmp_path, entry, message):
    path = tmp_path / 'offsets.yaml'
    path.write_text(f'imus:\n  3:\n    accelerometer: {entry}\n')
    with pytest.raises(OffsetsError, match=message):
        load_accelerometers(path, (3,))
