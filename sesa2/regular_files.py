"""Files that end: whoever opens a pipe waits without end, and a device gives without end."""

import stat
from pathlib import Path


def why_no_regular_file(path: str | Path) -> str:
    """Why a path leads to no regular file: to nothing, a folder, a pipe, a socket or a device; empty where it does."""
    try:
        mode = Path(path).stat().st_mode
    except OSError as error:
        return f'cannot be read: {error.strerror}'
    except ValueError as error:  # a NUL within
        return f'is no path: {error}'
    kinds = {stat.S_IFDIR: 'folder', stat.S_IFIFO: 'pipe', stat.S_IFSOCK: 'socket'}
    return '' if stat.S_ISREG(mode) else f'is a {kinds.get(stat.S_IFMT(mode), "device")}, expected a file'
