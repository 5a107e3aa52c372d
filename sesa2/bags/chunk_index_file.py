"""Where the chunks of a bag are, kept on the disk while the bag is written: it is wanted only at the end."""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryFile

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.records import ChunkIndex

_RECORD_HEAD = 9  # op code and length


class ChunkIndexFile:
    """Keeps an index of each chunk.

    With two chunks a second, a list of them takes many megabytes an hour. The file has no name, so that nothing is left
    of it after a kill.

    Parameters
    ----------
    folder
        on whose disk it is.

    Raises
    ------
    OSError
        by every method: it cannot be written or read.
    """

    def __init__(self, folder: Path):
        self._file = TemporaryFile(dir=folder)  # noqa: SIM115
        self._builder = RecordBuilder()
        self._n = 0

    def __len__(self) -> int:
        return self._n

    def append(self, index: ChunkIndex) -> None:
        """Keep one."""
        index.write(self._builder)
        self._file.write(self._builder.end())
        self._n += 1

    def __iter__(self) -> Iterator[ChunkIndex]:
        self._file.seek(0)
        stream = ReadDataStream(self._file)
        for _ in range(self._n):
            stream.read(_RECORD_HEAD)
            yield ChunkIndex.read(stream)

    def close(self) -> None:
        """Give the disk its space back."""
        self._file.close()
