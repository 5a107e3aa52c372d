"""What is swept is ours, and nobody's any more."""

import os
import signal
import subprocess
import sys

import pytest
from processes import Program

from sesa2.bags.recording import open_recording
from sesa2.bags.writing import new_bag
from sesa2.partial_files import lock_partial, sweep_partials, whole_folder, write_whole


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


def test_a_file_is_written_whole_or_not_at_all(tmp_path):
    path = tmp_path / 'file'
    write_whole(path, 'β')
    assert path.read_bytes() == 'β'.encode()
    with pytest.raises(FileExistsError):
        write_whole(path, 'γ')
    path.chmod(0o640)
    write_whole(path, b'\0', overwrite=True)
    assert path.read_bytes() == b'\0'
    assert path.stat().st_mode & 0o777 == 0o640
    with pytest.raises(TypeError):
        write_whole(path, 1, overwrite=True)
    assert path.read_bytes() == b'\0'
    assert list(tmp_path.iterdir()) == [path]


def test_what_is_no_file_is_not_replaced_by_one(tmp_path):
    pipe = tmp_path / 'pipe'
    os.mkfifo(pipe)
    for path in (pipe, tmp_path, '/dev/null'):
        with pytest.raises(FileExistsError):
            write_whole(path, '', overwrite=True)
    assert list(tmp_path.iterdir()) == [pipe]
    (tmp_path / 'link').symlink_to('aim')
    write_whole(tmp_path / 'link', 'text')
    assert (tmp_path / 'link').is_symlink()
    assert (tmp_path / 'aim').read_text() == 'text'


def test_a_folder_is_there_once_it_is_whole(tmp_path):
    path = tmp_path / 'folder'
    with pytest.raises(FileNotFoundError), whole_folder(path) as folder:
        (folder / 'no' / 'half').write_text('')
    assert list(tmp_path.iterdir()) == []
    path.mkdir()
    with whole_folder(path) as folder:
        (folder / 'all').write_text('')
        assert list(path.iterdir()) == []
    assert [p.name for p in path.iterdir()] == ['all']
    with pytest.raises(OSError, match='not empty'), whole_folder(path) as folder:
        pass
    assert list(tmp_path.iterdir()) == [path]
