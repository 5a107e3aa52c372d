"""A disk that is full leaves no file behind that the next run would trip over."""

import resource
import subprocess
import sys
from functools import partial

import pytest

from sesa2.bags.recording import open_recording

TRIAL = 'trial'


def run(folder, *arguments, most=None):
    """A command that may write files of so many bytes: the kernel ends a write there, as on a full disk."""
    limit = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (most, most)) if most is not None else None
    command = [sys.executable, '-m', 'sesa2.cli', *map(str, arguments)]
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=300, check=False, preexec_fn=limit
    )


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """A trial and what was estimated of it."""
    folder = tmp_path_factory.mktemp('disk')
    made = run(folder, 'twin', '--config', 'prototype3_4', '--seconds', '4', '--out', TRIAL)
    assert made.returncode == 0, made.stderr
    made = run(folder, 'replay', TRIAL, '--config', 'prototype3_4', '--models', 'pcc', '--out', 'est')
    assert made.returncode == 0, made.stderr
    return folder


COMMANDS = {
    'al.yaml': ('align', TRIAL, '--duration', '0.5', '--config', 'prototype3_4', '--out', 'al.yaml'),
    'v.html': ('view', 'est', '--html', 'v.html'),
    'rep': ('evaluate', 'est', '--truth', TRIAL, '--report', 'rep'),
    'again': ('replay', TRIAL, '--config', 'prototype3_4', '--models', 'pcc', '--out', 'again'),
}


@pytest.mark.parametrize('name', COMMANDS)
def test_a_full_disk_leaves_nothing_and_the_next_run_has_room(name, folder):
    before = sorted(p.name for p in folder.iterdir())
    failed = run(folder, *COMMANDS[name], most=600)
    assert failed.returncode == 1, failed.stdout
    (error,) = (line for line in failed.stderr.splitlines() if line.startswith('error: '))
    assert name in error
    assert 'File too large' in error
    assert sorted(p.name for p in folder.iterdir()) == before
    done = run(folder, *COMMANDS[name])
    assert done.returncode == 0, done.stderr
    assert (folder / name).exists()
    again = run(folder, *COMMANDS[name])
    assert again.returncode == 1
    assert name in again.stderr
    assert 'exists' in again.stderr


def test_a_bag_that_is_recorded_has_no_empty_metadata(tmp_path, monkeypatch):
    from sesa2.bags import writing
    from sesa2.errors import Sesa2Error

    bag = writing.record(tmp_path / 'bag')
    topic = bag.add_topic('/a', 'std_msgs/msg/String')
    bag.write(topic, 1, b'\0\1\0\0\2\0\0\0a\0\0\0')
    monkeypatch.setattr(writing.BagWriter, '_metadata', lambda bag: 'x' * (1 << 20))
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 19, hard))
    try:
        with pytest.raises(Sesa2Error, match='cannot be written'):
            bag.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert [p.name for p in (tmp_path / 'bag').iterdir()] == ['bag_0.mcap']
    with open_recording(tmp_path / 'bag') as recording:
        assert len(list(recording.messages())) == 1
