"""Files and folders that take their place once they are whole, and what is left of them after a kill.

Until then they are called `.NAME.PID.partial`, and their maker holds a lock on them, which the kernel takes back
whatever ends it. So what is left over can be told from what somebody still writes, in another container too.
"""

import fcntl
import logging
import os
import re
import shutil
from pathlib import Path

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
    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def sweep_partials(path: Path) -> list[Path]:
    """Remove what killed processes left of making this file or folder, with a warning for each.

    Returns
    -------
    What was removed. What a living process of this machine makes stays, and what is locked, and what cannot be
    removed.
    """
    pattern = re.compile(rf'\.{re.escape(path.name)}\.(\d{{1,10}})\.partial')
    try:
        found = [(p, match) for p in path.parent.iterdir() if (match := pattern.fullmatch(p.name))]
    except OSError:
        return []
    return [p for p, match in found if not _is_alive(int(match[1])) and _remove(p)]


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
