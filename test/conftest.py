"""What all tests share: a ROS graph of their own, and other people's recordings where they are."""

import os
import socket
from pathlib import Path

import pytest
from hypothesis import settings

# The same examples in every run.
settings.register_profile('same', derandomize=True)
settings.load_profile('same')


def _own_domain():
    """A ROS domain that no other test process on this host has, and the socket that keeps it so.

    Below 102 its ports stay clear of those that Linux gives out by itself.
    """
    for i in range(100):
        domain, lock = 1 + (os.getpid() + i) % 100, socket.socket()
        try:
            lock.bind(('127.0.0.1', 20_000 + domain))
        except OSError:
            lock.close()
        else:
            return str(domain), lock
    raise RuntimeError('100 test processes at once')


os.environ['ROS_DOMAIN_ID'], _DOMAIN_LOCK = _own_domain()
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
# Shared memory would be left behind by a test that kills a node.
os.environ['FASTDDS_BUILTIN_TRANSPORTS'] = 'UDPv4'


@pytest.fixture(scope='session')
def recordings():
    """Folder of other people's recordings, which are not part of the repository."""
    root = Path(__file__).resolve().parents[1]
    folder = Path(os.environ.get('SESA2_DATA', root.parent / 'shared/data'))
    if not folder.is_dir():
        pytest.skip(f'no recordings in {folder}; SESA2_DATA names their folder')
    return folder


@pytest.fixture(scope='session')
def cases():
    """Folder of inputs as other systems write them, which are not part of the repository."""
    root = Path(__file__).resolve().parents[1]
    folder = Path(os.environ.get('SESA2_CASES', root.parent / 'shared/cases'))
    if not folder.is_dir():
        pytest.skip(f'no cases in {folder}; SESA2_CASES names their folder')
    return folder


# Tests in which processes, boards and browsers go by the clock of the machine, whatever else it has to do.
_BY_THE_CLOCK = ('nodes', 'ros', 'system', 'viewer', 'firmware', 'examples')


def pytest_collection_modifyitems(items):
    """One that goes by the clock and fails is tried once more, and shown: a machine may stand still for seconds."""
    for item in items:
        if item.path.relative_to(Path(__file__).parent).parts[0] in _BY_THE_CLOCK:
            item.add_marker(pytest.mark.flaky(reruns=1, only_rerun='.'))
