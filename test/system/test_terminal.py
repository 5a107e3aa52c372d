"""The line on the terminal: what it says of the arm's tip, against a board whose arm is known."""

import re
import time
from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from processes import REPOSITORY
from scipy.spatial.transform import Rotation
from virtual_arms import halted

from sesa2.configuration import validate
from sesa2.estimation.estimator import Estimator
from sesa2.estimation.sweeps import Sweep
from sesa2.link.virtual.virtual_arm import VirtualArm
from sesa2.system.terminal import Terminal

TILTED = Rotation.from_rotvec([0.9, -1.2, 0.4])
LINKS = [TILTED * Rotation.from_rotvec(v) for v in ([0.2, 0.3, 0.0], [0.5, -0.1, 0.0])]


def configured(frame, base_id):
    return validate(
        {
            'arm': {'length': 0.3, 'base_orientation': TILTED.as_quat().tolist(), 'output_frame': frame},
            'imus': {'ids': [2, 5], 'positions': [0.1, 0.3], 'base_id': base_id},
            'models': ['rigid', 'pcc_exact'],
        }
    )


@pytest.fixture
def system(boards, request):
    """A virtual board whose arm holds still, and an estimator that has just measured it."""
    frame, base_id = request.param
    c = configured(frame, base_id)
    q = np.array([link.as_quat() for link in LINKS])
    rows = np.vstack([q, [TILTED.as_quat()]]) if base_id else q
    board = boards(VirtualArm((2, 5, base_id) if base_id else (2, 5), halted(rows)))
    sweep = Sweep(time.time_ns(), q, np.ones(2, bool), TILTED.as_quat() if base_id else None)
    estimator = SimpleNamespace(
        configuration=c,
        latest=Estimator(c).estimate([sweep]),
        received={2: 10, 5: 20},
        n_sweeps=10,
        fields=None,
        assembler=SimpleNamespace(dropped={'norm is not 1': 3}),
        unstamped=Counter({2: 4}),
    )
    absent = dict.fromkeys(('plant', 'field_source', 'bridge', 'calibration', 'tip_controller'))
    return SimpleNamespace(estimator=estimator, boards=[board], **absent)


SETTINGS = [('base', 0), ('world', 0), ('base', 8), ('world', 8)]


def line(system, capsys):
    Terminal(system).show_when_due()
    return capsys.readouterr().out


@pytest.mark.parametrize('system', SETTINGS, indirect=True)
def test_the_distance_from_the_truth_is_that_of_the_tips_under_a_tilted_base(system, capsys):
    latest = system.estimator.latest
    # What plays are arcs: that model is right, and straight links are off by so much, in whichever frame.
    tips = {name: result.ends[0, -1].copy() for name, result in latest.models.items()}
    off = 1e3 * np.linalg.norm(tips['rigid'] - tips['pcc_exact'])
    assert off > 1.0
    said = line(system, capsys)
    assert re.findall(r'\((\S+) mm off\)', said) == [f'{off:.1f}', '0.0']
    # The tip as printed is in the output frame.
    x, y, z = map(float, re.search(r'pcc_exact tip (\S+) (\S+) (\S+) m', said).groups())
    np.testing.assert_allclose([x, y, z], tips['pcc_exact'], atol=5.1e-4)
    latest.models['pcc_exact'].ends[0, -1] += TILTED.apply([0.0, 0.0, 0.007])
    assert re.findall(r'\((\S+) mm off\)', line(system, capsys))[1] == '7.0'


@pytest.mark.parametrize('system', SETTINGS[:1], indirect=True)
def test_rates_are_of_the_time_since_the_line_before(system, capsys, monkeypatch):
    now = time.monotonic()
    clock = SimpleNamespace(monotonic=lambda: now, time_ns=time.time_ns, monotonic_ns=time.monotonic_ns)
    monkeypatch.setattr('sesa2.system.terminal.time', clock)
    terminal = Terminal(system)
    terminal.show_when_due()
    for k in (1, 2):
        now += 2.0
        system.estimator.received = {2: 10 + 100 * k, 5: 20 + 50 * k}
        terminal.show_when_due()
        now += 0.5
        terminal.show_when_due()  # not due
        now -= 0.5
    lines = capsys.readouterr().out.splitlines()
    assert [text.split(' | ')[0] for text in lines[1:]] == ['Hz 50 25', 'Hz 50 25']


@pytest.mark.parametrize('system', SETTINGS[:1], indirect=True)
def test_the_summary_counts_what_was_dropped(system, capsys):
    Terminal(system).show_summary()
    assert capsys.readouterr().out == (
        'done; 10 sweeps estimated; 3 samples dropped: norm is not 1; '
        '4 samples without a stamp, the time of their arrival stood in\n'
    )


TARGET = np.array([0.05, 0.03, 0.15])
EXACT = {'slip': 0.0, 'affine': 0.0, 'affine_spread': 0.0, 'hollow': 0.0, 'sag': 0.0, 'imu_errors': 0.0}


def racked(**plant):
    """An arm on racks, its controller with a target, and nobody who estimates."""
    given = yaml.safe_load((REPOSITORY / 'config/tri_backbone.yaml').read_text())['/**']['ros__parameters']
    slow = {'controller': given['controller'] | {'length_rate': 0.02}}  # than the motors are
    c = validate(given | slow | {'plant': given['plant'] | plant})
    controller = c.create_controller()
    arm = c.create_plant()
    names = tuple(c.lengths.names)
    return SimpleNamespace(
        estimator=None,
        boards=[],
        field_source=None,
        plant=SimpleNamespace(open_loop_arm=lambda: (arm, names)),
        bridge=SimpleNamespace(imus=dict, links=[]),
        calibration=None,
        tip_controller=SimpleNamespace(controller=controller),
    )


@pytest.mark.parametrize(('plant', 'low', 'high'), [(EXACT, 0.0, 0.5), ({'slip': 0.85}, 10.0, 100.0)])
def test_what_open_loop_would_leave(plant, low, high, monkeypatch):
    now = 100.0
    clock = SimpleNamespace(monotonic=lambda: now, time_ns=time.time_ns, monotonic_ns=time.monotonic_ns)
    monkeypatch.setattr('sesa2.system.terminal.time', clock)
    system = racked(**plant)
    arm, _ = system.plant.open_loop_arm()
    controller = system.tip_controller.controller
    terminal = Terminal(system)
    assert terminal._control() == 'tip controller stopped, no target'
    controller.hear_target(TARGET)
    terminal.show_when_due()
    assert terminal._control() == 'tip controller stopped, target +0.050 +0.030 +0.150 m'
    controller.start()
    first = []
    for _ in range(1000):
        terminal.show_when_due()
        now += 0.0101
        first.append(arm.encoders)
    # No faster than the controller drives them.
    assert np.abs(np.diff(first, axis=0)).max() < 2.0 * 0.02 * 0.01 + 1e-4
    said = terminal._control()
    assert said.startswith('tip controller running, target')
    off = float(re.search(r'open loop (\S+) mm off', said)[1])
    assert low <= off <= high
    assert off == pytest.approx(1e3 * np.linalg.norm(arm.tip - TARGET), abs=0.06)
    controller.stop()
    terminal.show_when_due()
    assert 'open loop' not in terminal._control()
