"""Files and folders that take their place once they are whole, and what is left of them after a kill.

Until then they are called `.NAME.PID.partial`, and their maker holds a lock on them, which the kernel takes back
whatever ends it. So what is left over can be told from what somebody still writes, in another container too.
Windows has no such locks: what a kill leaves stays there.
"""

import errno
import logging
import os
import re
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

try:
    import fcntl
except ModuleNotFoundError:
    fcntl = None  # type: ignore[assignment]

_LOG = logging.getLogger('sesa2')


def partial_path(path: Path) -> Path:
    """Where a file or folder is made; beside its place, so that a rename puts it there in one step."""
    return path.with_name(f'.{path.name}.{os.getpid()}.partial')


def lock_partial(descriptor: int) -> None:
    """Hold what is being made until its descriptor is closed.

    Raises
    ------
    OSError
        somebody else holds it.
    """
    if fcntl:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def sweep_partials(path: Path) -> list[Path]:
    """Remove what killed processes left of making this file or folder, with a warning for each.

    Returns
    -------
    What was removed. What a living process of this machine makes stays, and what is locked, and what cannot be
    removed.
    """
    if not fcntl:
        return []
    pattern = re.compile(rf'\.{re.escape(path.name)}\.(\d{{1,10}})\.partial')
    try:
        found = [(p, match) for p in path.parent.iterdir() if (match := pattern.fullmatch(p.name))]
    except OSError:
        return []
    return [p for p, match in found if not _is_alive(int(match[1])) and _remove(p)]


def write_whole(path: str | Path, content: str | bytes, *, overwrite: bool = False) -> None:
    """Write a file in one step: whatever happens meanwhile, what was there before is there, or all of the new one.

    Parameters
    ----------
    path
        of the file; of a symbolic link, the file that it points to.
    content
        a text is written in UTF-8.
    overwrite
        whether the file may exist. Its mode then stays as it is; of a new file it is what the umask leaves.

    Raises
    ------
    FileExistsError
        something is there that is not to be overwritten, or is no file.
    OSError
        it cannot be written, for example on a full disk; nothing is left of the attempt then.
    """
    path = Path(path).resolve()
    if path.exists() and not (overwrite and path.is_file()):
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))
    sweep_partials(path)
    partial = partial_path(path)
    with partial.open('xb') as file:
        try:
            lock_partial(file.fileno())
            if path.exists():
                partial.chmod(stat.S_IMODE(path.stat().st_mode))
            file.write(content.encode() if isinstance(content, str) else content)
            file.flush()
            os.fsync(file.fileno())
            if not fcntl:
                file.close()  # no open file is renamed there
            partial.replace(path)
        except BaseException:
            partial.unlink(missing_ok=True)
            raise
    # The rename itself is on the disk only when its directory is.
    with _opened_folder(path.parent) as folder:
        if folder is not None:
            os.fsync(folder)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """A folder to be filled, which takes its place at the end; after an error nothing is left of it.

    Parameters
    ----------
    path
        where it is to be: nothing yet, or an empty folder.

    Raises
    ------
    OSError
        it cannot be made, or cannot take its place.
    """
    sweep_partials(path)
    partial = partial_path(path)
    partial.mkdir()
    with _opened_folder(partial) as lock:
        try:
            if lock is not None:
                lock_partial(lock)
            yield partial
            partial.rename(path)
        finally:
            shutil.rmtree(partial, ignore_errors=True)


@contextmanager
def _opened_folder(path: Path) -> Iterator[int | None]:
    """Its descriptor; None where folders cannot be opened."""
    if not fcntl:
        yield None
        return
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def _is_alive(pid: int) -> bool:
    if pid == os.getpid():
        return False  # of an earlier process of this number, or locked
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        pass
    return True


def _remove(path: Path) -> bool:
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return False
    try:
        lock_partial(descriptor)
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()
    except OSError:
        return False
    finally:
        os.close(descriptor)
    _LOG.warning('%s removed: it was left by a process that was killed while it wrote', path)
    return True
