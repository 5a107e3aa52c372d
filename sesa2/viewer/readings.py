"""What is read at a glance, as HTML: state, rates, what is wrong, and calibration."""

from collections.abc import Sequence
from html import escape

import numpy as np

from sesa2.messages.topic_names import magnetometer_name
from sesa2.sensing.imu.accelerometer_calibration import SIDES
from sesa2.sensing.imu.bno055.scores import Scores
from sesa2.shape.rotations import FloatArray
from sesa2.viewer.live import Live
from sesa2.viewer.magnet_poses import DOUBTFUL, UNUSED, WELL, WRONG, magnetometer_colour

_GREEN, _AMBER, _RED, _GREY = '#2b8a3e', '#e67700', '#c92a2a', '#868e96'
_LEVELS = {1: _AMBER, 2: _RED}
_AT_MOST = 6


def state_html(live: Live, steerable: bool) -> str:
    """What the system does, in two lines that keep their height."""
    estimator, bridge, player = (live.heard(node) for node in ('estimator', 'serial_bridge', 'player'))
    recorder = live.heard('recorder')
    if estimator:
        colour, state = _GREEN, 'streaming'
    elif bridge:
        colour, state = _GREEN, 'calibrating'
    elif player:
        colour, state = _GREEN, 'playing'
    else:
        colour, state = _GREY, 'stopped' if steerable else 'nothing runs'
    if recorder:
        state += ', recording'
    facts = []
    facts += [estimator[part].message for part in ('sweeps', 'fields') if part in estimator]
    if estimator and live.latency_s is not None and abs(live.latency_s) < 10.0:
        facts.append(f'{1e3 * live.latency_s:.1f} ms late')
    if links := [part for name, part in bridge.items() if name.split()[0] == 'link']:
        counts = [(key, int(n)) for link in links for key, n in link.values.items() if n.isdigit()]
        facts.append(f'{sum(n for key, n in counts if key == "lost_sweeps")} lost')
        facts.append(f'{sum(n for key, n in counts if key.startswith("frame_errors_"))} damaged')
    second = ' · '.join(map(escape, facts)) or '&nbsp;'
    if not steerable:
        second += '<br>View only: no <code>sesa2 run</code> is here to be steered.'
    return _block(f'<b style="color:{colour}">● {state}</b><div style="color:{_GREY}">{second}</div>')


def complaints_html(live: Live) -> str:
    """What the nodes complain about; what several parts of a node say alike is said once."""
    nodes = ('system', 'estimator', 'serial_bridge', 'calibration', 'recorder', 'player', 'plant')
    found: dict[tuple[int, str, str], list[str]] = {}
    said = (
        (node, part, d)
        for node in nodes
        for part, d in live.heard(node).items()
        # That a sensor is not calibrated yet is said by its bars.
        if d.level
        and not (node == 'calibration' and part.startswith('imu_'))
        # That nothing runs is said by the state.
        and not (node == 'system' and d.level < 2)
    )
    for node, part, d in said:
        found.setdefault((d.level, node, d.message), []).append(part)
    worst = sorted(found.items(), key=lambda item: -item[0][0])
    lines = [
        f'<div style="color:{_LEVELS.get(level, _RED)}">{escape(f"{node}: {_parts(parts)}: {message}")}</div>'
        for (level, node, message), parts in worst[:_AT_MOST]
    ]
    if len(worst) > _AT_MOST:
        lines.append(f'<div>and {len(worst) - _AT_MOST} more on /diagnostics</div>')
    return _block(''.join(lines)) if lines else ''


def _parts(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f'{len(parts)} parts, {parts[0]} to {parts[-1]}'


def tip_control_html(live: Live, target: FloatArray | None) -> str:
    """What the tip controller does, and how far the tip and the true one are from the target, (3,), m."""
    said = live.heard('tip_controller').get('tip')
    if said is None:
        return _block(f'<b style="color:{_GREY}">● no tip controller is heard</b>')
    colour = _LEVELS.get(said.level, _GREEN if said.values.get('state') == 'RUNNING' else _GREY)
    lines = [f'<b style="color:{colour}">● {escape(said.message)}</b>']
    if 'left_mm' not in said.values:  # whatever was said before it was there
        lines.append('it has no target yet: drag the ball')
    if target is not None:
        lines.append(f'target {" ".join(f"{v:+.3f}" for v in target)} m')
        if target[2] <= 0.0:
            lines.append('not above the clamp: not sent, the target before stays')
        lines.append(' · '.join(_distances(live, target)) or '&nbsp;')
    return _block('<br>'.join(lines))


def _distances(live: Live, target: FloatArray) -> list[str]:
    c = live.configuration
    backbone = live.backbones.get(c.controller.model) if c and live.heard('estimator') else None
    tips = {
        'tip': None if backbone is None or not len(backbone) else backbone[-1, :3],
        'true tip': live.truth_tip,
    }
    return [
        f'{name} {1e3 * np.linalg.norm(tip - target):.1f} mm off'
        for name, tip in tips.items()
        if tip is not None
    ]


def rates_html(live: Live) -> str:
    """Rate of each IMU and each magnetometer, and what is the matter with it."""
    c = live.configuration
    if c is None:
        return _block('nothing heard yet')
    estimator = live.heard('estimator')
    rows = []
    for i, s, enabled in zip(c.imus.ids, c.imus.positions, c.imus.enabled, strict=True):
        said = estimator.get(f'imu_{i}')
        rate = said.values.get('rate_hz', '') if said else ''
        alive = i in live.sensors
        state = 'off' if not enabled else 'measures' if alive else 'missing'
        colour = _GREY if not enabled else _GREEN if alive else _RED
        rows.append(
            f'<tr><td>{i}</td><td>{s:g} m</td><td>{escape(rate)}</td><td style="color:{colour}">{state}</td></tr>'
        )
    tables = [_rates_table(('IMU', 'at'), rows)] if rows else []
    if ids := c.magnetometers.ids:
        m = c.magnetometers
        rows = []
        for i, segment, s in zip(ids, m.segments, m.positions, strict=True):
            said = estimator.get(magnetometer_name(i))
            rgb = magnetometer_colour(said, i in m.masked)
            rate = said.values.get('rate_hz', '') if said else ''
            rows.append(
                f'<tr><td>{i}</td><td>{segment}</td><td>{s:g} m</td><td>{escape(rate)}</td>'
                f'<td style="color:rgb{rgb}">{_MAGNETOMETERS[rgb]}</td></tr>'
            )
        tables.append(_rates_table(('magnetometer', 'segment', 'at'), rows))
    return _block(''.join(tables))


_MAGNETOMETERS = {WELL: 'measures', DOUBTFUL: 'doubtful', WRONG: 'wrong', UNUSED: 'not used'}


def _rates_table(columns: Sequence[str], rows: Sequence[str]) -> str:
    head = ''.join(f'<th>{h}</th>' for h in (*columns, 'Hz', ''))
    return f'<table style="{_TABLE}"><tr>{head}</tr>{"".join(rows)}</table>'


def calibration_html(live: Live) -> str:
    """Four bars for each IMU, three steps each, and what to do next; without fusion in the chips the six poses."""
    c = live.configuration
    if c is not None and c.serial.fusion == 'RAW':
        return _poses_html(live, c.imus.all_ids)
    if c is None or not live.scores:
        return _block('No IMU has told its calibration yet: it comes from the board.')
    ids = c.imus.all_ids
    head = ''.join(f'<th>{h}</th>' for h in ('IMU', *Scores._fields))
    rows = []
    for i in ids:
        scores = live.scores.get(i)
        bars = (
            ''.join(
                f'<td data-score="imu_{i} {name} {score}">{_bar(score)}</td>'
                for name, score in (scores._asdict() if scores else {}).items()
            )
            or '<td colspan="4">nothing heard</td>'
        )
        step = scores.next_step(c.serial.fusion) if scores else ''
        done = scores is not None and scores.complete(c.serial.fusion)
        rows.append(
            f'<tr><td><b>{i}</b></td>{bars}</tr><tr><td></td>'
            f'<td colspan="4" style="color:{_GREEN if done else _GREY};font-size:0.85em;padding-bottom:0.4em">'
            f'{escape(step)}</td></tr>'
        )
    return _block(f'<table style="{_TABLE}"><tr>{head}</tr>{"".join(rows)}</table>')


def _poses_html(live: Live, ids: Sequence[int]) -> str:
    """The poses of each accelerometer's calibration that have been held, and what to do next."""
    said = live.heard('calibration')
    if not said:
        return _block(
            'Chips without fusion have no scores. Their accelerometers are calibrated in the mode calibrate.'
        )
    rows = []
    for i in ids:
        part = said.get(f'imu_{i}')
        held = int(part.values.get('poses', '0')) if part else 0
        colour = _GREEN if part and not part.level else _GREY
        text = escape(part.message if part else 'nothing heard')
        rows.append(
            f'<tr><td><b>{i}</b></td><td data-poses="imu_{i} {held}">{_bar(held, len(SIDES))}</td></tr><tr><td></td>'
            f'<td style="color:{colour};font-size:0.85em;padding-bottom:0.4em">{text}</td></tr>'
        )
    return _block(f'<table style="{_TABLE}"><tr><th>IMU</th><th>poses</th></tr>{"".join(rows)}</table>')


_TABLE = 'width:100%;text-align:left;border-spacing:0.3em 0.1em'


def _bar(score: int, of: int = 3) -> str:
    colour = _GREEN if score >= of else _AMBER if score else _RED
    boxes = ''.join(
        f'<span style="flex:1;height:0.55em;border-radius:2px;background:{colour if k < score else "#e9ecef"}"></span>'
        for k in range(of)
    )
    return f'<div style="display:flex;gap:2px" title="{score} of {of}">{boxes}</div>'


def _block(content: str) -> str:
    return f'<div style="font-size:0.85em;line-height:1.5;padding:0.2em 0.8em">{content}</div>'
