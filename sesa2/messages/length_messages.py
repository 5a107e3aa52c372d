"""Measured lengths of backbones, sensor_msgs/JointState by name: out of messages, and into them."""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from sesa2.configuration import Configuration
from sesa2.errors import Sesa2Error, shortened
from sesa2.messages.cdr import CdrLayout
from sesa2.messages.joint_states import JointStateLayout
from sesa2.shape.rotations import FloatArray
from sesa2.time import NS

LENGTHS_TYPE = 'sensor_msgs/msg/JointState'

UNREADABLE = 'cut short, or with another number of positions than names'
NAMELESS = 'without the name of a backbone'
UNKNOWN = 'with names that are not in lengths.names'
TWICE = 'with a name twice'
NO_LENGTH = 'with a length that is no positive number'

# Layouts that are remembered; a driver has one, and whoever changes its own all the time is read slowly.
_LAYOUTS_MAX = 16


class SaidLengths(NamedTuple):
    """What messages of one layout say, in the order in which they came.

    Attributes
    ----------
    backbones : (m,)
        indices of the backbones that they name.
    stamps_ns : (n,)
        0 where there is none, ns.
    lengths : (n, m)
        as said, before scale and offset, m.
    rows : (n,)
        which of the messages that were given these are.
    """

    backbones: tuple[int, ...]
    stamps_ns: np.ndarray
    lengths: FloatArray
    rows: np.ndarray


class LengthIntake:
    """Stands between messages and lengths, live and in recordings alike. Each message may name some of the backbones.

    Parameters
    ----------
    names
        of the backbones (`lengths.names`).
    scales, offsets
        one for all or one each: length = scale × what is said + offset, m. They tell what can be a length.

    Attributes
    ----------
    refused
        number of messages that were not used, by reason.
    example
        what was wrong with the first of each, for people.
    """

    def __init__(
        self, names: Sequence[str], scales: Sequence[float] = (1.0,), offsets: Sequence[float] = (0.0,)
    ):
        self._names = list(names)
        n = len(self._names)
        self._scales, self._offsets = (np.broadcast_to(np.array(v), (n,)) for v in (scales, offsets))
        self._layouts: list[tuple[JointStateLayout, tuple[int, ...]]] = []
        self.refused: Counter[str] = Counter()
        self.example: dict[str, str] = {}

    @classmethod
    def of(cls, configuration: Configuration) -> 'LengthIntake':
        """That of a configuration."""
        lengths = configuration.lengths
        return cls(lengths.names, lengths.scales, lengths.offsets)

    def take(self, data: bytes) -> SaidLengths | None:
        """Take a message in CDR, either byte order; None where it is refused."""
        return next(self.take_many([data]), None)

    def take_many(self, data: Sequence[bytes]) -> Iterator[SaidLengths]:
        """Take messages, in the order in which they came: those of each layout together."""
        rest = np.arange(len(data))
        while len(rest):
            first = data[rest[0]]
            layout, backbones = self._layout_of(first)
            if layout is None:
                rest = rest[1:]
                continue
            same = [k for k in rest.tolist() if len(data[k]) == len(first)]
            said = np.frombuffer(b''.join([data[k] for k in same]), np.uint8).reshape(len(same), len(first))
            alike = (said[:, :2] == said[0, :2]).all(axis=1)
            alike &= (said[:, 12 : layout.positions_at] == said[0, 12 : layout.positions_at]).all(axis=1)
            rows = np.array(same)[alike]
            rest = np.setdiff1d(rest, rows, assume_unique=True)
            found = self._read(layout, backbones, said[alike], rows)
            if len(found.rows):
                yield found

    def _read(
        self, layout: JointStateLayout, backbones: tuple[int, ...], said: np.ndarray, rows: np.ndarray
    ) -> SaidLengths:
        at, order = layout.positions_at, layout.order
        head = np.ascontiguousarray(said[:, 4:12]).view(f'{order}i4').astype(np.int64)
        nanoseconds = np.ascontiguousarray(said[:, 8:12]).view(f'{order}u4').astype(np.int64)[:, 0]
        values = np.ascontiguousarray(said[:, at : at + 8 * len(backbones)]).view(f'{order}f8').astype(float)
        which = list(backbones)
        lengths = self._scales[which] * values + self._offsets[which]
        good = (np.isfinite(lengths) & (lengths > 0.0)).all(axis=1)
        if not good.all():
            bad = values[~good][0]
            self._refuse(
                NO_LENGTH, f'{[float(v) for v in bad]} m of {list(layout.names)}', int((~good).sum())
            )
        return SaidLengths(
            backbones, (head[:, 0] * NS + nanoseconds)[good], np.ascontiguousarray(values[good]), rows[good]
        )

    def _layout_of(self, data: bytes) -> tuple[JointStateLayout | None, tuple[int, ...]]:
        """How a message is laid out and whose lengths it has; None, and counted, where it cannot be used."""
        for layout, backbones in self._layouts:
            if layout.fits(data):
                return layout, backbones
        try:
            layout = JointStateLayout.of(data)
            layout.read(data)
        except Sesa2Error as error:
            return self._refuse(UNREADABLE, str(error))
        if not layout.names:
            return self._refuse(NAMELESS, f'expected {self._names}')
        if unknown := [name for name in layout.names if name not in self._names]:
            return self._refuse(UNKNOWN, f'{unknown}, expected some of {self._names}')
        if len(set(layout.names)) < len(layout.names):
            return self._refuse(TWICE, f'{list(layout.names)}')
        found = layout, tuple(self._names.index(name) for name in layout.names)
        self._layouts = [found, *self._layouts[: _LAYOUTS_MAX - 1]]
        return found

    def _refuse(self, reason: str, example: str, n: int = 1) -> tuple[None, tuple[int, ...]]:
        self.refused[reason] += n
        self.example.setdefault(reason, shortened(example))
        return None, ()


class LengthMessages:
    """Makes the messages of backbones, named in order."""

    def __init__(self, names: Sequence[str]):
        layout = CdrLayout().header('').strings(names).uint32(len(names)).doubles(len(names))
        self._template = layout.uint32(0).uint32(0).template()

    def make_lengths(self, stamps_ns: np.ndarray, lengths: FloatArray) -> np.ndarray:
        """Messages at stamps (n,), ns, of lengths (n, n_backbones), m: a message a row, (n, size), uint8."""
        return self._template.make(stamps_ns, lengths)
