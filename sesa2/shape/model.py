"""What every shape model is: what was measured in, a backbone out."""

import re
from abc import ABC, abstractmethod
from functools import lru_cache
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from sesa2.shape.arm import GeometryError
from sesa2.shape.backbone import Backbone
from sesa2.shape.layout import SEGMENTS_TOLERANCE, Layout
from sesa2.shape.measured import Measured
from sesa2.shape.options import ModelOptions
from sesa2.shape.rotations import FloatArray
from sesa2.shape.stretched import Stretching

_NAME = re.compile('[a-z][a-z0-9]*(_[a-z0-9]+)*')
# What a model keeps ready for a set of arc lengths; each keeps what suits it.
Kept = TypeVar('Kept')

# Every model by its name, in the order in which their files were loaded.
MODELS: 'dict[str, type[Model[Any]]]' = {}


class Model(ABC, Generic[Kept]):
    """A shape model for an arm and its sensors. What does not depend on the measurement is computed once, here.

    A class that has a `name` is a model from then on: it can be chosen in a configuration, and `create_model` makes it.

    Parameters
    ----------
    layout
        the arm and where its sensors sit.
    options
        a record of its class's `Options`.

    Attributes
    ----------
    name
        of the model, in the configuration and on the ROS graph.
    needs
        kinds of measurements that it cannot do without, fields of `Measured`; of an arm that stretches, lengths too.
    Options
        its options, a frozen record.
    layout
        the arm and its sensors.
    stretching
        how lengths of the segments stretch the arm.
    finds_lengths
        whether the lengths of the segments are part of what it finds, and need not be measured.
    coordinate_names
        of the coordinates that its backbones have; none where they have none.
    doubts
        of how it suits the sensors, for people.
    link_ends : (n_links + 1,)
        arc lengths at which the links that stand for the arm on the ROS graph begin and end, base to tip, m.
    link_middles : (n_links,)
        arc lengths at which the links take their orientation, m.
    """

    name: ClassVar[str]
    needs: tuple[str, ...] = ('orientations',)
    finds_lengths: ClassVar[bool] = False
    Options: ClassVar[type[ModelOptions]] = ModelOptions
    coordinate_names: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        name = vars(cls).get('name')
        if name is None:  # a family of models
            return
        if not _NAME.fullmatch(name):
            raise GeometryError(f'model {name!r}: expected a name in lower case, as topics have')
        other = MODELS.get(name)
        if other and (other.__module__, other.__qualname__) != (cls.__module__, cls.__qualname__):
            raise GeometryError(
                f'model {name!r} of {cls.__module__}: {other.__module__} has one of this name'
            )
        MODELS[name] = cls

    def __init__(self, layout: Layout, options: ModelOptions):
        del options
        self.layout = layout
        if layout.stretches and not self.finds_lengths and 'lengths' not in self.needs:
            self.needs = (*self.needs, 'lengths')
        self.stretching = Stretching(layout)
        if 'orientations' in self.needs and not layout.n_imu:
            raise GeometryError(f'imu_positions is empty, the model {self.name!r} needs at least one IMU')

        def precompute(key: bytes) -> Kept:
            s = np.frombuffer(key)
            layout.arm.check_on_arm(s)
            return self._precompute(s)

        self._cached = lru_cache(maxsize=16)(precompute)

    def _set_link_ends(self, link_ends: ArrayLike) -> None:
        """For the constructor of a model. Links of an arm that stretches end where its segments do, too.

        So each has one stretch, and what is on it keeps its share of it.
        """
        ends = np.asarray(link_ends, dtype=float)
        if self.layout.stretches:
            inner = self.layout.segment_ends[1:-1]
            apart = np.abs(inner[:, None] - ends).min(axis=-1) > SEGMENTS_TOLERANCE
            ends = np.sort(np.append(ends, inner[apart]))
        self.link_ends = ends
        self.link_middles = 0.5 * (self.link_ends[:-1] + self.link_ends[1:])

    @property
    def n_links(self) -> int:
        """Number of links on the ROS graph."""
        return len(self.link_ends) - 1

    def fit(self, measured: Measured) -> Backbone:
        """Fit the backbone to what was measured.

        Parameters
        ----------
        measured
            at one instant, or a batch.

        Returns
        -------
        The backbone.

        Raises
        ------
        GeometryError
            something that the model needs is absent, or has a shape that the layout does not have.
        """
        measured.check(self.name, self.needs, self.layout)
        backbone = self._fit(measured)
        if measured.lengths is None or backbone.lengths is not None:
            return backbone
        return self.stretching.stretch(backbone, measured.lengths)

    @abstractmethod
    def _fit(self, measured: Measured) -> Backbone:
        """The backbone of the arm at rest, which `fit` stretches; or, with its `lengths`, as long as they are."""

    def at(self, s: ArrayLike) -> Kept:
        """What the model keeps ready for these arc lengths, (n,), m; computed at the first call and kept."""
        return self._cached(np.ascontiguousarray(s, dtype=float).tobytes())

    @abstractmethod
    def _precompute(self, s: FloatArray) -> Kept: ...
