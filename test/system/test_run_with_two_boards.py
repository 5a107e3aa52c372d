"""`sesa2 run` and `sesa2 board` with sixteen IMUs on two boards."""

import signal

import pytest
import yaml
from processes import command, failed_clearly

from sesa2.configuration import files
from sesa2.system.terminal import _line
from sesa2.system.virtual_source import make_virtual_boards

SHIPPED = files.load(files.find('two_boards'))


def test_a_run_makes_as_many_virtual_boards_as_are_needed(tmp_path):
    with command(tmp_path, 'run', '--config', 'two_boards', '--source', 'sim') as program:
        program.until(lambda: 'of 16' in program.output, 'sixteen rates')
        program.until(lambda: ' mm off)' in program.output, 'a distance from the truth')
        program.signal(signal.SIGINT)
        assert program.ended() == 0, program.errors
    assert 'lost 0 sweeps' in program.output
    assert all(f'IMU {i}' not in program.errors for i in range(1, 17))


def test_virtual_boards_are_served_each_on_its_port_and_run_over_all(tmp_path):
    link = tmp_path / 'board'
    with command(tmp_path, 'board', '--config', 'two_boards', '--link', link) as boards:
        boards.until(lambda: '--port' in boards.output, 'what to type')
        assert f'--port {link},{link}2' in boards.output
        for ports in (['--port', f'{link},{link}2'], ['--port', link, '--port', f'{link}2']):
            with command(tmp_path, 'run', '--config', 'two_boards', '--source', 'serial', *ports) as program:
                program.until(lambda program=program: 'of 16' in program.output, 'sixteen')
                program.signal(signal.SIGINT)
                assert program.ended() == 0, program.errors
        assert not link.with_name('board3').exists()
        boards.signal(signal.SIGINT)
        assert boards.ended() == 0, boards.errors


def test_one_port_for_sixteen_imus_is_a_mistake(tmp_path):
    with command(
        tmp_path, 'run', '--config', 'two_boards', '--source', 'serial', '--port', '/dev/a'
    ) as program:
        assert program.ended() == 1
    assert 'imus.ids[8]: got 9, expected 1 to 8: 8 on each board' in program.errors
    assert 'Traceback' not in program.errors


def test_ids_of_any_size_where_no_board_is_asked(tmp_path):
    values = {
        'run': {'source': 'external'},
        'arm': {'length': 0.3},
        'imus': {'ids': [300, 41], 'positions': [0.1, 0.3], 'base_id': 1000},
        'models': ['pcc'],
    }
    (tmp_path / 'arm.yaml').write_text(yaml.safe_dump({'/**': {'ros__parameters': values}}))
    with command(tmp_path, 'run', '--config', 'arm.yaml', '--duration', '1') as program:
        assert failed_clearly(
            program, 'no IMU is heard; expected /imu_300/data, /imu_41/data, /imu_1000/data'
        )


def test_no_board_is_left_where_one_cannot_be_made(tmp_path):
    (tmp_path / 'board2').write_text('precious')
    with pytest.raises(Exception, match='no symbolic link'):
        make_virtual_boards(SHIPPED, tmp_path / 'board')
    assert not (tmp_path / 'board').is_symlink()


@pytest.mark.parametrize(
    ('values', 'expected'),
    [
        ({1: 99.6, 2: 100.4}, '100 100'),
        (dict.fromkeys(range(1, 9), 100.0), ' '.join(['100'] * 8)),
        (dict.fromkeys(range(1, 17), 100.2), '100 of 16'),
        ({**dict.fromkeys(range(1, 17), 100.0), 5: 99.0}, '99 to 100 of 16'),
        ({**dict.fromkeys(range(1, 17), 100.0), 5: 0.0, 12: 50.0}, '0 to 100 of 16, low: IMU 5 12'),
        (dict.fromkeys(range(1, 17), 0.0), '0 of 16'),
    ],
)
def test_a_line_of_many_imus(values, expected):
    assert _line(values, '.0f') == expected
