"""What of a configuration known points may tell, and the configuration that it leads to."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from sesa2.alignment.self_calibration import HEADING_STD, MOUNTING_STD
from sesa2.configuration import Configuration
from sesa2.shape.models.pcc_delta import AFFINE_STD, PccDeltaOptions
from sesa2.shape.rotations import FloatArray, from_rotation_vector, multiply, wrap

_SLIP_STD = (0.3, 0.1, 0.010)  # of the three numbers of `pcc_delta.slip`; the last in m
_SCALE_STD = 0.05
_OFFSET_STD = 0.010  # m


class Unknown(NamedTuple):
    """A number that is to be learnt as a correction.

    Attributes
    ----------
    name
        for people.
    key
        of the configuration that it goes into.
    expected
        standard deviation before anything is known, rad, m or a plain number.
    unit
        `°`, `mm` or empty: in which it is told.
    """

    name: str
    key: str
    expected: float
    unit: str

    def signed(self, value: float) -> str:
        """A correction for people, with its sign."""
        return f'{"-" if value < 0.0 else "+"}{self.told(abs(value))}'

    def told(self, value: float) -> str:
        """A value of it for people, without the unit."""
        scale = {'°': 180.0 / np.pi, 'mm': 1e3}.get(self.unit, 1.0)
        return f'{scale * value:.2f}' if self.unit else f'{value:.3f}'


class ArmUnknowns:
    """The unknowns of one arm as one of its models sees it.

    Lengths on the axis of a segment have a scale and an offset each. Backbones beside it slip in common: `pcc_delta`
    has a model of that; for others they share a scale and an offset.

    Parameters
    ----------
    c
        the configuration that is corrected.
    model
        the name of the model.
    heard : (n_imu,)
        IMUs that have measured; of the others nothing is learnt.

    Attributes
    ----------
    items
        the unknowns, in order.
    """

    def __init__(self, c: Configuration, model: str, heard: np.ndarray):
        self._c, self._model = c, model
        self._imus = np.flatnonzero(heard)
        self._on_axis, self._beside = _backbones(c)
        self._slips = model == 'pcc_delta' and bool(len(self._beside)) and not len(self._on_axis)
        items = []
        for i in self._imus:
            imu = f'IMU {c.imus.ids[i]}'
            items += [
                Unknown(f'{imu}: mounting about {a}', 'imus.mount_orientations', MOUNTING_STD, '°')
                for a in 'xyz'
            ]
            items.append(Unknown(f'{imu}: heading', 'imus.headings', HEADING_STD, '°'))
        if c.imus.base_id:
            items += [
                Unknown(f'IMU {c.imus.base_id}: mounting about {a}', 'imus.base_mount_orientation', std, '°')
                for a, std in zip('xyz', (MOUNTING_STD,) * 3, strict=True)
            ]
        if model == 'pcc_delta':
            items.append(Unknown('affine curvature', 'pcc_delta.affine', AFFINE_STD, ''))
        if self._slips:
            units = ('', '', 'mm')
            names = ('slip by bend', 'slip by stretch', 'slip always')
            items += [
                Unknown(name, 'pcc_delta.slip', std, unit)
                for name, std, unit in zip(names, _SLIP_STD, units, strict=True)
            ]
        else:
            for which, name in self._lengths():
                items.append(Unknown(f'{name}: scale', 'lengths.scales', _SCALE_STD, ''))
                items.append(Unknown(f'{name}: offset', 'lengths.offsets', _OFFSET_STD, 'mm'))
                assert len(which)
        self.items = tuple(items)

    def _lengths(self) -> list[tuple[np.ndarray, str]]:
        """Backbones that share a scale and an offset, and what they are called."""
        if not self._c.has_lengths:
            return []
        names = self._c.lengths.names
        groups = [(np.array([i]), names[i]) for i in self._on_axis]
        if len(self._beside) and not groups:
            groups.append((self._beside, ', '.join(names[i] for i in self._beside)))
        return groups

    @property
    def expected(self) -> FloatArray:
        """Standard deviations before anything is known, (k,)."""
        return np.array([item.expected for item in self.items])

    def corrected(self, x: FloatArray) -> Configuration:
        """The configuration with corrections, (k,)."""
        c, n = self._c, len(self._imus)
        mountings, headings = c.mountings.copy(), c.headings.copy()
        own = x[: 4 * n].reshape(n, 4)
        mountings[self._imus] = multiply(from_rotation_vector(own[:, :3]), mountings[self._imus])
        headings[self._imus] = wrap(headings[self._imus] + own[:, 3])
        c = c.with_alignment(mountings, headings)
        rest = list(x[4 * n :])
        if c.imus.base_id:
            base = multiply(from_rotation_vector(np.array(rest[:3])), c.base_mounting)
            c = replace(c, imus=replace(c.imus, base_mount_orientation=_numbers(base)))
            del rest[:3]
        options = c.options['pcc_delta']
        assert isinstance(options, PccDeltaOptions)
        if self._model == 'pcc_delta':
            c = c.with_options('pcc_delta', affine=_numbers(np.array(options.affine) + rest.pop(0)))
        if self._slips:
            return c.with_options('pcc_delta', slip=_numbers(np.reshape(options.slip, (-1, 3)) + rest))
        lengths = c.lengths
        for which, _ in self._lengths():
            all_of = len(lengths.names)
            scales, offsets = (
                np.broadcast_to(of, (all_of,)).copy() for of in (lengths.scales, lengths.offsets)
            )
            # Of what is said now: scale × (what was known of it) + offset.
            scale = 1.0 + rest.pop(0)
            scales[which] *= scale
            offsets[which] = scale * offsets[which] + rest.pop(0)
            lengths = replace(lengths, scales=_numbers(scales), offsets=_numbers(offsets))
        return replace(c, lengths=lengths)


def _backbones(c: Configuration) -> tuple[np.ndarray, np.ndarray]:
    """Those on the axis, and those beside it."""
    if not c.has_lengths:
        return np.zeros(0, dtype=int), np.zeros(0, dtype=int)
    radii = np.broadcast_to(c.lengths.radii, (len(c.lengths.names),))
    return np.flatnonzero(radii == 0.0), np.flatnonzero(radii > 0.0)


def _numbers(values: Sequence[Any] | FloatArray) -> tuple[float, ...]:
    return tuple(np.round(np.ravel(values), 9).tolist())
