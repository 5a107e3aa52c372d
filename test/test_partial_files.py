"""What is swept is ours, and nobody's any more."""

import signal
import subprocess
import sys

import pytest
from processes import Program

from sesa2.bags.recording import open_recording
from sesa2.bags.writing import new_bag
from sesa2.partial_files import lock_partial, sweep_partials


@pytest.fixture
def gone():
    """The number of a process that has ended."""
    process = subprocess.Popen([sys.executable, '-c', ''])
    process.wait()
    return process.pid


def test_what_a_dead_process_left_is_swept_and_told(tmp_path, gone, caplog):
    file, folder = tmp_path / f'.save.{gone}.partial', tmp_path / f'.save.99999{gone}.partial'
    file.write_text('half')
    (folder / 'inner').mkdir(parents=True)
    assert sorted(sweep_partials(tmp_path / 'save')) == sorted([file, folder])
    assert list(tmp_path.iterdir()) == []
    assert f'{file} removed: it was left by a process that was killed' in caplog.text


def test_what_is_not_surely_debris_stays(tmp_path, gone):
    living = subprocess.Popen([sys.executable, '-c', 'input()'], stdin=subprocess.PIPE)
    names = [
        f'.save.{living.pid}.partial',
        f'.other.{gone}.partial',
        f'.save.{gone}.partial.txt',
        f'.save.x{gone}.partial',
        f'save.{gone}.partial',
        '.save.original',
        '.save.1.partial',  # not ours to ask, but alive
    ]
    for name in names:
        (tmp_path / name).write_text('')
    (tmp_path / 'precious').write_text('')
    (tmp_path / f'.save.{gone}.partial').symlink_to('precious')
    locked = tmp_path / f'.save.1{gone}.partial'
    locked.write_text('')
    with locked.open() as held:  # by a process that is not seen here, as in another container
        lock_partial(held.fileno())
        assert sweep_partials(tmp_path / 'save') == []
        assert len(list(tmp_path.iterdir())) == len(names) + 3
    assert sweep_partials(tmp_path / 'save') == [locked]
    living.communicate(b'\n')
    assert sweep_partials(tmp_path / 'nowhere' / 'save') == []


WRITER = """
import sys
from sesa2.bags.writing import new_bag
with new_bag(sys.argv[1]) as bag:
    number = bag.add_topic('/a', 'std_msgs/msg/String')
    bag.write(number, 1, bytes(16))
    bag.flush()
    print('under way', flush=True)
    sys.stdin.read()
"""


def test_a_killed_writer_of_a_bag_leaves_nothing_for_good(tmp_path):
    path = tmp_path / 'bag'
    with Program(['-c', WRITER, path], tmp_path, stdin=subprocess.PIPE) as one:
        one.until(lambda: 'under way' in one.output, 'a bag')
        partial = tmp_path / f'.bag.{one.pid}.partial'
        with Program(['-c', WRITER, path], tmp_path, stdin=subprocess.PIPE) as other:
            other.until(lambda: 'under way' in other.output, 'another bag')
            assert partial.is_dir()  # it is being written
            one.signal(signal.SIGKILL)
            one.ended()
            with new_bag(path):
                assert not partial.exists()
                assert (tmp_path / f'.bag.{other.pid}.partial').is_dir()
    with open_recording(path) as recording:
        assert not recording.problems
