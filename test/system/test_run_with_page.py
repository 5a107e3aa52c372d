"""`sesa2 run --viewer` as a process: what becomes of it when the page cannot be shown, or is lost."""

import os
import signal
import socket
from pathlib import Path

import pytest
from processes import REPOSITORY, command, failed_clearly

pytest.importorskip('viser', reason='viser is not installed: pip install sesa2[viewer]')

RUN = ('run', '--config', REPOSITORY / 'config/prototype3_8.yaml', '--source', 'sim', '--viewer')


def child_of(program):
    [child] = Path(f'/proc/{program.pid}/task/{program.pid}/children').read_text().split()
    return int(child)


def test_without_its_page_it_does_not_go_on(tmp_path):
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', 0))
        taken.listen()
        port = taken.getsockname()[1]
        with command(tmp_path, *RUN, port) as program:
            assert failed_clearly(program, f'port {port}', 'in use')
            assert 'Hz' not in program.output  # nothing was started


def test_a_lost_page_stops_nothing(tmp_path):
    with command(tmp_path, *RUN, 0) as program:
        program.until(lambda: 'the arm is shown on http://127.0.0.1:' in program.output, 'the page')
        program.until(lambda: 'pcc tip' in program.output, 'the shape')
        os.kill(child_of(program), signal.SIGKILL)
        program.until(lambda: 'the system goes on' in program.errors, 'that it is told')
        told = program.output.count('pcc tip')
        program.until(lambda: program.output.count('pcc tip') > told + 1, 'more shapes')
        program.signal(signal.SIGINT)
        assert program.ended() == 0
        assert 'Traceback' not in program.errors
