"""What can be wrong with magnets and magnetometers."""

from collections.abc import Callable

import numpy as np

from sesa2.configuration.magnetic_sections import MagnetometerSection, MagnetSection
from sesa2.configuration.records import Configuration
from sesa2.shape.kinematics import create_kinematics
from sesa2.shape.kinematics.coordinate_limits import CoordinateLimits

Expect = Callable[[bool, str, str], bool]


def check_magnets(c: Configuration, expect: Expect) -> None:
    """Note every mistake.

    Parameters
    ----------
    c
        whose values are each of the right kind and in their range.
    expect
        takes whether something is right, and where and what is wrong if it is not; gives the first back.
    """
    magnets, magnetometers = c.magnets, c.magnetometers
    if not magnetometers.ids:
        expect(
            magnetometers == MagnetometerSection(),
            'magnetometers.ids',
            'is missing, and other keys are given',
        )
        expect(magnets == MagnetSection(), 'magnetometers.ids', 'is missing, and there are magnets')
        return
    for place, needed in (('segments.lengths', c.segments.lengths), ('magnets.segments', magnets.segments)):
        expect(bool(needed), place, 'is missing, and magnetometers need it')
    counts = [_check_counts(c, expect), _check_places(c, expect), _check_rings(magnets, expect)]
    if all(counts) and magnets.segments and c.segments.lengths:
        _check_distances(c, expect)


def _check_counts(c: Configuration, expect: Expect) -> bool:
    magnets, magnetometers, right = c.magnets, c.magnetometers, True
    n = len(magnets.segments)
    for key in ('positions', 'outer_diameters', 'heights', 'remanences', 'inner_diameters'):
        got = len(getattr(magnets, key))
        allowed = (n,) if key == 'positions' else (1, n)
        what = (
            'one per entry of segments' if key == 'positions' else 'one for all or one per entry of segments'
        )
        right &= expect(
            got in allowed,
            f'magnets.{key}',
            f'has {got} entries, expected {" or ".join(map(str, sorted(set(allowed))))}: {what}',
        )
    n = len(magnetometers.ids)
    for i, name in enumerate(magnetometers.ids):
        right &= expect(
            name not in magnetometers.ids[:i], f'magnetometers.ids[{i}]', f'got {name} a second time'
        )
    for key in ('segments', 'positions'):
        got = len(getattr(magnetometers, key))
        right &= expect(got == n, f'magnetometers.{key}', f'has {got} entries, expected {n}: one per id')
    for key in ('radii', 'azimuths', 'axial_offsets', 'axes', 'gains'):
        got = len(getattr(magnetometers, key))
        right &= expect(
            got in (1, n),
            f'magnetometers.{key}',
            f'has {got} entries, expected 1 or {n}: one for all or one per id',
        )
    if len(magnetometers.axes) in (1, n):
        got, rows = len(magnetometers.offsets), magnetometers.n_readings
        right &= expect(
            got in (1, n, rows),
            'magnetometers.offsets',
            f'has {got} entries, expected 1, {n} or {rows}: one for all, one per id, or one per id and axis',
        )
    got = len(magnetometers.mount_orientations)
    if expect(
        got in (4, 4 * n),
        'magnetometers.mount_orientations',
        f'has {got} numbers, expected 4 or {4 * n}: x y z w, one for all or one per id',
    ):
        for i, norm in enumerate(
            np.linalg.norm(np.reshape(magnetometers.mount_orientations, (-1, 4)), axis=1)
        ):
            right &= expect(
                abs(norm - 1.0) < 0.01,
                f'magnetometers.mount_orientations[{4 * i}:{4 * i + 4}]',
                f'has norm {norm:.4g}, expected a unit quaternion x y z w',
            )
    else:
        right = False
    got = len(magnetometers.earth_field)
    right &= expect(got == 3, 'magnetometers.earth_field', f'has {got} numbers, expected 3: x y z')
    for i, name in enumerate(magnetometers.masked):
        known = name in magnetometers.ids
        right &= expect(known, f'magnetometers.masked[{i}]', f'got {name}, expected one of magnetometers.ids')
    used = set(magnetometers.ids) - set(magnetometers.masked)
    return right & expect(
        bool(used), 'magnetometers.masked', 'got every id, expected at least one that is used'
    )


def _check_places(c: Configuration, expect: Expect) -> bool:
    lengths, right = c.segments.lengths, True
    for section in ('magnets', 'magnetometers'):
        own = getattr(c, section)
        for i, k in enumerate(own.segments):
            known = not lengths or expect(
                k <= len(lengths),
                f'{section}.segments[{i}]',
                f'got {k}, expected 1 to {len(lengths)}, a segment',
            )
            right &= known
            if known and lengths and i < len(own.positions):
                s, length = own.positions[i], lengths[k - 1]
                right &= expect(
                    s <= length * (1.0 + 1e-9),
                    f'{section}.positions[{i}]',
                    f'{s:g} m is beyond the end of segment {k}, which is {length:g} m long',
                )
    return right


def _check_rings(magnets: MagnetSection, expect: Expect) -> bool:
    right, inner, outer = True, magnets.inner_diameters, magnets.outer_diameters
    for i in range(max(len(inner), len(outer)) if inner and outer else 0):
        small, large = (of[min(i, len(of) - 1)] for of in (inner, outer))
        right &= expect(
            small < large,
            f'magnets.inner_diameters[{min(i, len(inner) - 1)}]',
            f'got {small:g} m, expected less than the outer diameter, {large:g} m',
        )
    for i, strength in enumerate(magnets.remanences):
        right &= expect(strength != 0.0, f'magnets.remanences[{i}]', 'got 0, expected another number')
    return right


def _check_distances(c: Configuration, expect: Expect) -> None:
    """Nearer to a magnet than its series goes no sensor can be, were it on the straight arm."""
    kinematics = create_kinematics('pcc', c.segments.lengths)
    readings = c.layout.readings
    assert readings is not None
    predictor = readings(CoordinateLimits(kinematics, c.segments.bend_max, c.segments.stretch))
    for i, distances in enumerate(predictor.distances(kinematics.rest)):
        for k, (distance, magnet) in enumerate(zip(distances, predictor.magnets.magnets, strict=True)):
            expect(
                distance >= magnet.nearest,
                f'magnetometers.positions[{i}]',
                f'is {1e3 * distance:.1f} mm from the centre of magnet {k + 1}, expected at least '
                f'{1e3 * magnet.nearest:.1f} mm: nearer than that its field is not known',
            )
