"""What a configuration means, for people."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from sesa2.configuration.records import Configuration
from sesa2.sensing.imu.addresses import CHANNELS, address_of
from sesa2.shape.layout import Layout
from sesa2.shape.suitability import suitability


def describe(c: Configuration) -> str:
    """The arm, its IMUs, markers and models, as text.

    Parameters
    ----------
    c
        a valid configuration.
    """
    frame = (
        f'the clamp ({c.frame_id})'
        if c.arm.output_frame == 'base'
        else f'world axes, origin at the clamp ({c.frame_id})'
    )
    on_base = f'measured by IMU {c.imus.base_id}' if c.imus.base_id else _quaternion(c.base)
    hangs, places = _places(c)
    lines = [
        f'Arm        {c.arm.length:.3f} m long, {2e3 * c.arm.radius:.1f} mm thick; base orientation q_WB {on_base}',
        f'Results    in {frame}; {_timing(c)}',
        f'Source     {c.run.source}, mode {c.run.mode}',
        *([f'Suits      {_suits(c)}'] if c.imus.ids else []),
        '',
        'IMUs, base to tip',
        *table(
            ('id', *hangs, 's [m]', 'used', 'mounting q_LS (x y z w)', 'heading [°]'),
            [
                (i, *place, f'{s:.4f}', 'yes' if used else 'no', _quaternion(q), f'{np.degrees(h):.2f}')
                for i, place, s, used, q, h in zip(
                    c.imus.ids, places, c.imus.positions, c.imus.enabled, c.mountings, c.headings, strict=True
                )
            ],
        ),
        *_segments(c),
        '',
        *_magnets(c),
        'Models',
        *table(
            ('name', 'links', 'shortest [mm]', 'longest [mm]', 'topics'),
            [_model(c, name) for name in c.models],
        ),
        *(f'  {name}: {doubt}' for name in c.models for doubt in c.create_model(name).doubts),
        '',
        'Markers',
        *table(
            ('name', 's [m]'),
            [(name, f'{s:.4f}') for name, s in zip(c.markers.names, c.markers.positions, strict=True)],
        ),
    ]
    return '\n'.join(line.rstrip() for line in lines)


def _segments(c: Configuration) -> list[str]:
    """The segments, and what measures their lengths; nothing where the arm has none."""
    ends = c.layout.segment_ends
    if not c.segments.lengths:
        return []
    low, high = c.segments.stretch
    rows: list[tuple[object, ...]] = []
    for k, (begin, end) in enumerate(pairwise(ends.tolist())):
        span = f'{low * (end - begin):.4f} to {high * (end - begin):.4f}'
        row = (k + 1, f'{begin:.4f}', f'{end:.4f}', span)
        rows.append((*row, _measured_by(c, k)) if c.has_lengths else row)
    head = ('segment', 'from s [m]', 'to s [m]', 'length [m]', *(['measured by'] if c.has_lengths else []))
    timing = f'; a length older than {c.lengths.timeout:g} s is unknown' if c.has_lengths else ''
    return ['', f'Segments, base to tip{timing}', *table(head, rows)]


def _measured_by(c: Configuration, segment: int) -> str:
    names = zip(c.lengths.names, c.backbones.length_weights[segment], strict=True)
    return ', '.join(name for name, weight in names if weight)


def _magnets(c: Configuration) -> list[str]:
    """The magnets and the magnetometers, if there are any."""
    if not c.magnetometers.ids:
        return []
    ends = c.layout.segment_ends
    magnets, magnetometers = c.magnets.places(ends), c.magnetometers.places(ends)
    of = magnetometers
    return [
        'Magnets',
        *table(
            ('s [m]', 'inner, outer diameter, height [mm]', 'remanence [T]'),
            [
                (
                    f'{s:.4f}',
                    f'{1e3 * m.inner_diameter:g}, {1e3 * m.outer_diameter:g}, {1e3 * m.height:g}',
                    f'{m.remanence:g}',
                )
                for s, m in zip(magnets.positions, magnets.magnets, strict=True)
            ],
        ),
        '',
        f'Magnetometers in use: up to {1e3 * of.range:g} mT, noise {1e6 * of.noise:g} µT',
        *table(
            ('id', 's [m]', 'beside [mm]', 'azimuth [°]', 'axes'),
            [
                (i, f'{s:.4f}', f'{1e3 * r:.1f}', f'{np.degrees(a):.1f}', axes)
                for i, s, r, a, axes in zip(of.ids, of.positions, of.radii, of.azimuths, of.axes, strict=True)
            ],
        ),
        '',
    ]


def _places(c: Configuration) -> tuple[tuple[str, ...], list[tuple[object, ...]]]:
    """Heads and cells of where each IMU hangs: its channel, after its port where there are several; none without."""
    addresses = [address_of(imu_id) for imu_id in c.imus.ids]
    ports = c.serial.all_ports
    if max(c.imus.all_ids, default=0) > CHANNELS * len(ports):
        return (), [()] * len(addresses)
    if len(ports) > 1:
        return ('port', 'channel'), [(ports[board], channel) for board, channel in addresses]
    return ('channel',), [(channel,) for _, channel in addresses]


def _timing(c: Configuration) -> str:
    how = 'taken as they come' if c.time_alignment == 'none' else "interpolated to the sweep's first stamp"
    latency = f', {1e3 * c.imus.latency:g} ms of latency taken off' if c.imus.latency else ''
    return f'samples {how}{latency}; a sweep waits {1e3 * c.sweep_timeout:g} ms for missing IMUs'


def _model(c: Configuration, name: str) -> tuple[object, ...]:
    model = c.create_model(name)
    lengths = 1e3 * np.diff(model.link_ends)
    return (
        name,
        model.n_links,
        f'{lengths.min():.1f}',
        f'{lengths.max():.1f}',
        f'{name}/joint_states, {"coordinates, " if model.coordinate_names else ""}markers, tip, shape',
    )


def _suits(c: Configuration) -> str:
    """Which model suits the IMUs that are used, and what they cannot tell."""
    used = tuple(s for s, on in zip(c.imus.positions, c.imus.enabled, strict=True) if on)
    suits = suitability(Layout(c.layout.arm, used))
    gap = (
        f'up to {suits.widest:.3f} m without an IMU ({100.0 * suits.widest / c.arm.length:.0f} % of the arm)'
    )
    if suits.too_few:
        return f'{suits.model}, but IMUs are too few: {gap}; an arm that bends two ways there is far off in any model'
    absent = '' if suits.model in c.models else ' (not in models)'
    return (
        f'{suits.model}{absent} where the arm bends as a whole, pcc_exact where sections are driven apart: {gap};'
        f' more than {suits.bends} bends at once cannot be told'
    )


def _quaternion(q: Sequence[float] | np.ndarray) -> str:
    return '[' + ', '.join(f'{v:.4g}' for v in q) + ']'


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    """Lines of a table for the terminal."""
    if not rows:
        return ['  none']
    cells = [[str(cell) for cell in row] for row in [head, *rows]]
    widths = [max(len(row[i]) for row in cells) for i in range(len(head))]
    return ['  ' + '  '.join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) for row in cells]
