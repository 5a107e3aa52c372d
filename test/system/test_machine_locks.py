"""Names that one process at a time may hold on this machine."""

import subprocess
import sys

import pytest

from sesa2.system.machine_locks import MachineLocks

HOLD = """
import sys
from sesa2.system.machine_locks import MachineLocks
locks = MachineLocks()
print(repr(locks.hold(sys.argv[1:])), flush=True)
sys.stdin.read()
"""


@pytest.fixture
def holder():
    """Starts a process that holds names until its standard input is closed."""
    started = []

    def start(*names):
        process = subprocess.Popen(
            [sys.executable, '-c', HOLD, *names], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        started.append(process)
        return process, process.stdout.readline().strip()

    yield start
    for process in started:
        process.kill()
        process.communicate()


needs_linux = pytest.mark.skipif(sys.platform != 'linux', reason='abstract sockets are of Linux')


@needs_linux
def test_a_name_is_held_by_one_process_and_free_when_it_is_killed(holder):
    first, told = holder('/a', '/b')
    assert told == "''"
    ours = MachineLocks()
    assert ours.hold(['/c', '/b']) == '/b'
    assert ours.hold(['/c', '/d']) == ''
    assert holder('/d')[1] == "'/d'"
    first.kill()
    first.wait()
    assert ours.hold(['/a', '/b']) == ''
    assert holder('/c', '/d')[1] == "''"
    ours.release()
    assert holder('/a')[1] == "''"


@needs_linux
def test_who_cannot_have_all_holds_none(holder):
    holder('/m')
    ours = MachineLocks()
    assert ours.hold(['/a', '/m', '/z']) == '/m'
    assert holder('/a', '/z')[1] == "''"
    ours.release()


@needs_linux
def test_domains_and_long_names_are_told_apart(holder, monkeypatch):
    long = '/' + 200 * 'a'
    assert holder(f'{long}1')[1] == "''"
    ours = MachineLocks()
    assert ours.hold([f'{long}2']) == ''
    assert ours.hold([f'{long}1']) == f'{long}1'
    monkeypatch.setenv('ROS_DOMAIN_ID', '213')
    assert ours.hold([f'{long}1']) == ''
    ours.release()


def test_those_who_share_no_graph_do_not_hinder_each_other(holder, monkeypatch):
    holder('/a')
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF')
    assert MachineLocks().hold(['/a']) == ''
