"""What every family of shapes with coordinates is: coordinates in, a backbone and its derivatives out."""

from abc import ABC, abstractmethod
from functools import lru_cache
from typing import Any, ClassVar, Generic

import numpy as np
from numpy.typing import ArrayLike

from sesa2.shape.arm import Arm, GeometryError
from sesa2.shape.kinematics.segment_chain import Places, SegmentChain, Segments
from sesa2.shape.model import Kept
from sesa2.shape.rotations import FloatArray

# Every family by its name, in the order in which their files were loaded.
KINEMATICS: 'dict[str, type[Kinematics[Any]]]' = {}


class Kinematics(ABC, Generic[Kept]):
    """A family of shapes, bound to the rest lengths of an arm's segments.

    Places on the arm are material arc lengths s: metres from the clamp along the arm at rest, 0 to the sum of the rest
    lengths. A place keeps its fraction of its segment when the segment stretches, as what is glued to it does. The
    joint between two segments belongs to both.

    A class that has a `name` is a family from then on: it can be chosen, and `create_kinematics` makes it.

    Parameters
    ----------
    segment_lengths : (m,)
        lengths of the segments at rest, base to tip, m.

    Attributes
    ----------
    name
        of the family, in the configuration.
    segment_coordinates
        names of one segment's coordinates; `length` is among them.
    segment_lengths : (m,)
        as given.
    arm
        the arm at rest.
    coordinate_names
        of all coordinates in their order, `segment_<k>_<name>` with k from 1.
    rest : (n_coordinates,)
        coordinates of the straight arm at rest.

    Raises
    ------
    GeometryError
        there is no segment, or a length is not a positive number.
    """

    name: ClassVar[str]
    segment_coordinates: ClassVar[tuple[str, ...]]

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        name = vars(cls).get('name')
        if name is None:
            return
        other = KINEMATICS.get(name)
        if other and (other.__module__, other.__qualname__) != (cls.__module__, cls.__qualname__):
            raise GeometryError(
                f'kinematics {name!r} of {cls.__module__}: {other.__module__} has one of this name'
            )
        KINEMATICS[name] = cls

    def __init__(self, segment_lengths: ArrayLike):
        lengths = np.array(segment_lengths, dtype=float)
        if lengths.ndim != 1 or not len(lengths):
            raise GeometryError(
                f'segment_lengths of shape {lengths.shape}, expected a list of at least one length'
            )
        wrong = np.flatnonzero(~(np.isfinite(lengths) & (lengths > 0.0)))
        if len(wrong):
            raise GeometryError(
                f'segment_lengths[{wrong[0]}] = {lengths[wrong[0]]} m, expected a positive number'
            )
        self.segment_lengths = lengths
        self._joints = np.array([0.0, *np.cumsum(lengths)])
        self.arm = Arm(float(self._joints[-1]))
        each = self.segment_coordinates
        self.coordinate_names = tuple(
            f'segment_{k}_{name}' for k in range(1, len(lengths) + 1) for name in each
        )
        self.rest = np.outer(lengths, [name == 'length' for name in each]).ravel()
        for array in (self.segment_lengths, self._joints, self.rest):
            array.setflags(write=False)
        self._cached = lru_cache(maxsize=16)(lambda key: self._places(np.frombuffer(key)))

    @property
    def n_coordinates(self) -> int:
        """Number of coordinates of the arm."""
        return len(self.coordinate_names)

    def backbone(self, q: ArrayLike) -> SegmentChain[Kept]:
        """The backbone that coordinates describe.

        Parameters
        ----------
        q : batch + (n_coordinates,)
            rad and m, in the order of `coordinate_names`.

        Returns
        -------
        The backbone, in B; its `jacobian(s)` shares the work of its positions and orientations.

        Raises
        ------
        GeometryError
            the last axis is not n_coordinates long.
        """
        q = np.array(q, dtype=float)  # kept: a solver may go on changing its own
        if q.shape[-1:] != (self.n_coordinates,):
            raise GeometryError(f'coordinates of shape {q.shape}, expected (..., {self.n_coordinates})')
        m, each = len(self.segment_lengths), len(self.segment_coordinates)
        return SegmentChain(self._segments(q.reshape(*q.shape[:-1], m, each)), each, self.at)

    def jacobian(self, q: ArrayLike, s: ArrayLike) -> FloatArray:
        """Derivatives of the poses by the coordinates.

        Parameters
        ----------
        q : batch + (n_coordinates,)
            rad and m.
        s : (n,)
            material arc lengths, m.

        Returns
        -------
        batch + (n, 6, n_coordinates). Rows 0–2: position in B, m per unit of the coordinate. Rows 3–5: rotation vector
        w in B, dR = [w]ₓ R, rad per unit.

        Raises
        ------
        GeometryError
            the last axis of q is not n_coordinates long, or an arc length is not on the arm.
        """
        return self.backbone(q).jacobian(s)

    def at(self, s: ArrayLike) -> Places[Kept]:
        """What is kept ready for these arc lengths, (n,), m; computed at the first call and kept.

        Raises
        ------
        GeometryError
            s is not a list, or an arc length is not on the arm.
        """
        s = np.ascontiguousarray(s, dtype=float) if np.ndim(s) else np.asarray(s)
        if s.ndim != 1:
            raise GeometryError(f'arc lengths of shape {s.shape}, expected (n,)')
        return self._cached(s.tobytes())

    def _places(self, s: FloatArray) -> Places[Kept]:
        self.arm.check_on_arm(s)
        segments = range(len(self.segment_lengths))
        section = np.searchsorted(self._joints[1:-1], s, side='left')
        fraction = (s - self._joints[section]) / self.segment_lengths[section]
        all_sections = np.concatenate([section, segments[:-1]]).astype(int)
        all_fractions = np.concatenate([fraction, np.ones(len(segments) - 1)])
        return Places(
            n=len(s),
            section=all_sections,
            within=[_run(section == k) for k in segments],
            beyond=[_run(section > k) for k in segments],
            kept=self._precompute(all_sections, all_fractions),
        )

    @abstractmethod
    def _segments(self, own: FloatArray) -> Segments[Kept]:
        """The segments with coordinates batch + (m, c)."""

    @abstractmethod
    def _precompute(self, section: np.ndarray, fraction: FloatArray) -> Kept:
        """What the family keeps for places in segments `section`, at fractions 0 to 1 of them; (n,) each."""


def _run(chosen: np.ndarray) -> np.ndarray | slice:
    """Which are chosen: a slice where they stand together, as numpy copies nothing then."""
    indices = np.flatnonzero(chosen)
    if not len(indices):
        return slice(0, 0)
    together = indices[-1] - indices[0] == len(indices) - 1
    return slice(int(indices[0]), int(indices[-1]) + 1) if together else indices
