"""What all tests share: a ROS graph of their own, and other people's recordings where they are."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

# The same examples in every run.
settings.register_profile('same', derandomize=True)
settings.load_profile('same')

# A domain of its own for each test process, on this host only. Below 102 its ports stay clear of those that Linux gives
# out by itself.
os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)
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
