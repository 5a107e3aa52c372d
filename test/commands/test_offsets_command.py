"""Offsets from files of other programs, as the commands take and show them."""

import pytest

from sesa2.cli import main
from sesa2.configuration import files
from sesa2.sensing.imu.bno055.offsets import Offsets, load_offsets

REGISTERS = 'E9FF0500E2FF7800CAFE2A00FFFF00000100E803C802'
OFFSETS = Offsets((-23, 5, -30), (120, -310, 42), (-1, 0, 1), 1000, 712)


@pytest.fixture
def chip(tmp_path):
    path = tmp_path / 'chip.txt'
    path.write_text(REGISTERS)
    return path


def test_files_of_chips_go_into_a_calibration_file(tmp_path, chip, capsys):
    out = tmp_path / 'offsets.yaml'
    assert main(['offsets', f'2={chip}', f'4={chip}', '--out', str(out)]) == 0
    assert main(['offsets', f'4={chip}', f'6={chip}', '--out', str(out)]) == 0
    assert load_offsets(out, [2, 4, 6]).offsets == dict.fromkeys([2, 4, 6], OFFSETS)
    said = capsys.readouterr().out
    assert 'IMU 2: accel (-23, 5, -30), mag (120, -310, 42), gyro (-1, 0, 1), radii 1000 and 712\n' in said
    assert said.count('took the place of what was there') == 1


def test_a_bad_file_writes_nothing(tmp_path, chip, capsys):
    bad, out = tmp_path / 'bad', tmp_path / 'offsets.yaml'
    bad.write_text('E9FF')
    assert main(['offsets', f'2={chip}', f'4={bad}', '--out', str(out)]) == 1
    assert '4 digits in hexadecimal' in capsys.readouterr().err
    assert main(['offsets', f'2={chip}', f'2={chip}', '--out', str(out)]) == 1
    assert 'IMU 2 is given twice' in capsys.readouterr().err
    assert not out.exists()
    with pytest.raises(SystemExit) as ended:
        main(['offsets', 'chip.txt', '--out', str(out)])
    assert ended.value.code == 2


def configured(tmp_path, file):
    path = tmp_path / 'arm.yaml'
    text = files.find('prototype3_4').read_text() + f'    calibration: {{file: {file}}}\n'
    path.write_text(text)
    return str(path)


def test_check_reads_the_calibration_file_as_a_run_does(tmp_path, chip, capsys):
    assert main(['check', configured(tmp_path, chip)]) == 1
    assert 'does not say of which IMU' in capsys.readouterr().err
    out = tmp_path / 'offsets.yaml'
    assert main(['check', configured(tmp_path, out)]) == 0
    assert f'calibration file {out} is not there' in capsys.readouterr().err
    main(['offsets', f'2={chip}', f'4={chip}', '--out', str(out)])
    assert main(['check', configured(tmp_path, out)]) == 0
    told = capsys.readouterr()
    rows = [line.split() for line in told.out.splitlines() if line.endswith('1000 712       ')]
    assert [row[:4] for row in rows] == [['2', '-23', '5', '-30'], ['4', '-23', '5', '-30']]
    assert 'no offsets of IMU 6, 8: not calibrated' in told.err
