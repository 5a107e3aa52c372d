"""Which files may be chosen from afar: by whoever sees a page, or is on the ROS graph."""

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from sesa2.configuration.records import Configuration
from sesa2.configuration.validation import Mistake
from sesa2.errors import Sesa2Error

# Parameters that name a file to read or to write.
FILES = ('run.bag', 'run.trial', 'calibration.file', 'record.file')


class ChosenFiles:
    """Keeps what is chosen from afar under one folder; what was named where the program was started may be anywhere.

    Parameters
    ----------
    folder
        under which files may be chosen.
    """

    def __init__(self, folder: str | Path):
        self.folder = Path(folder).resolve()
        self._named: set[tuple[str, str]] = set()

    def allow(self, c: Configuration) -> None:
        """The files that this configuration names, for what it names them for."""
        self._named |= set(_named(c))

    def mistakes(self, c: Configuration) -> list[Mistake]:
        """Which of the files that a configuration names may not be chosen, and why."""
        return [
            Mistake(path, self._refusal(name))
            for path, name in _named(c)
            if (path, name) not in self._named and not self._holds(name)
        ]

    def check(self, name: str | Path) -> None:
        """Refuse a file that may not be chosen.

        Raises
        ------
        Sesa2Error
            it is not under the folder.
        """
        if not self._holds(name):
            raise Sesa2Error(self._refusal(name))

    def _holds(self, name: str | Path) -> bool:
        """Whether it is there once links and `..` are followed; relative names are of the working folder."""
        try:
            path = Path(name).resolve()
            with suppress(FileNotFoundError, NotADirectoryError):
                path.stat()  # raises for a link to itself, which resolve() lets pass since Python 3.13
            return path.is_relative_to(self.folder)
        except (OSError, RuntimeError, ValueError):  # a link to itself, a name with a zero byte
            return False

    def _refusal(self, name: str | Path) -> str:
        return (
            f'{name} is not under {self.folder}, where sesa2 was started (--files DIR allows another folder)'
        )


def _named(c: Configuration) -> Iterable[tuple[str, str]]:
    flat = c.flat()
    return [(path, flat[path]) for path in FILES if flat[path]]
