"""The ball that is the tip's target: what is sent of it and when, and what the words say. Dragging is the browser's."""

import asyncio
import time
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from processes import REPOSITORY

pytest.importorskip('viser', reason='viser is not installed: pip install sesa2[viewer]')

from sesa2.configuration import validate
from sesa2.viewer.live import Diagnostic, Live
from sesa2.viewer.readings import tip_control_html
from sesa2.viewer.scene import Scene
from sesa2.viewer.server import open_server
from sesa2.viewer.target_ball import TargetBall
from sesa2.viewer.tip_panel import TipPanel

VALUES = yaml.safe_load((REPOSITORY / 'config/tri_backbone.yaml').read_text())['/**']['ros__parameters']
ARM = validate(VALUES)
NEAR, FAR = np.array([0.05, 0.03, 0.15]), np.array([0.0, 0.0, 0.30])


@pytest.fixture(scope='module')
def server():
    one = open_server(port=0)
    yield one
    one.stop()


@pytest.fixture
def ball(server):
    Scene(server).configure(ARM)
    one = TargetBall(server)
    one.configure(ARM)
    return one


def drag(ball, *places, phase='update'):
    for place in places:
        event = SimpleNamespace(phase=phase, target=SimpleNamespace(position=np.array(place, dtype=float)))
        asyncio.run(ball._drag(event))


class Listening:
    """A steering whose graph listens, or does not yet."""

    def __init__(self):
        self.sent, self.listens = [], True

    def aim(self, target, frame):
        if self.listens:
            self.sent.append((tuple(target), frame))
        return self.listens


@pytest.fixture
def clock(monkeypatch):
    now = SimpleNamespace(s=100.0)
    monkeypatch.setattr(
        'sesa2.viewer.tip_panel.time', SimpleNamespace(monotonic=lambda: now.s, time=time.time)
    )
    return now


@pytest.fixture
def panel(server, clock):
    Scene(server).configure(ARM)
    one = TipPanel(server, Live(configuration=ARM), Listening(), lambda action, **_: action())
    one.configure(ARM)
    return one


def test_the_ball_waits_at_the_tip_of_the_straight_arm(ball):
    np.testing.assert_allclose(ball._handles.position, [0.0, 0.0, 0.16], atol=1e-9)
    assert ball.position is None
    assert ball.dragged() is None


def test_what_is_out_of_reach_is_grey_and_the_nearest_point_is_shown(ball):
    drag(ball, NEAR)
    np.testing.assert_array_equal(ball.dragged(), NEAR)
    assert len(set(np.asarray(ball._ball.color).tolist())) > 1
    assert not ball._clipped.visible
    drag(ball, FAR)
    ball.dragged()
    assert len(set(np.asarray(ball._ball.color).tolist())) == 1
    assert ball._clipped.visible
    # Straight up it comes to 1.5 times its length.
    np.testing.assert_allclose(ball._clipped.position, [0.0, 0.0, 0.24], atol=1e-6)
    assert ball.reached.left == pytest.approx(0.06, abs=1e-6)
    drag(ball, NEAR)
    ball.dragged()
    assert not ball._clipped.visible


def test_targets_of_others_move_it_but_neither_its_own_nor_while_it_is_held(ball):
    ball.hear(NEAR)
    np.testing.assert_array_equal(ball._handles.position, NEAR)
    places = NEAR + np.outer([0.01, 0.02, 0.03], [1.0, 0.0, 0.0])
    drag(ball, places[0], phase='start')
    ball.hear(FAR)
    for place in places:
        drag(ball, place)
        ball.dragged()
    drag(ball, places[-1], phase='end')
    ball.dragged()
    for place in places:  # what it said itself comes back late
        ball.hear(place)
        np.testing.assert_array_equal(ball.position, places[-1])
    ball.hear(FAR)
    np.testing.assert_array_equal(ball.position, FAR)


def test_twenty_a_second_are_sent_and_the_last_in_any_case(panel, clock):
    sent = panel._steering.sent
    for k in range(101):  # a second at a hundred a second
        drag(panel.ball, NEAR + np.array([0.0001 * k, 0.0, 0.0]))
        panel.send()
        clock.s += 0.01
    clock.s += 0.05
    panel.send()
    assert 15 <= len(sent) <= 22
    assert sent[-1] == (tuple(NEAR + np.array([0.01, 0.0, 0.0])), 'base_link')
    clock.s += 1.0
    panel.send()
    assert sent[-2] != sent[-1]  # a ball that rests says nothing more


def test_what_nobody_heard_is_sent_when_somebody_listens(panel, clock):
    panel._steering.listens = False
    drag(panel.ball, NEAR)
    for _ in range(3):
        panel.send()
        clock.s += 0.1
    assert not panel._steering.sent
    panel._steering.listens = True
    panel.send()
    assert [target for target, _ in panel._steering.sent] == [tuple(NEAR)]


def test_below_the_clamp_nothing_is_sent_and_it_is_said(panel):
    drag(panel.ball, [0.05, 0.0, -0.02])
    panel.send()
    assert not panel._steering.sent
    assert panel.ball.reached is None
    assert not panel.ball._clipped.visible
    panel._live.hear({'tip_controller: tip': Diagnostic(0, 'stopped', {}, time.monotonic())})
    assert 'not above the clamp: not sent' in tip_control_html(panel._live, panel.ball.position)


def test_an_arm_without_a_controller_has_no_ball(panel):
    assert panel._folder.visible
    panel.configure(validate({**VALUES, 'controller': {}}))
    assert not panel._folder.visible
    panel._live.target = NEAR
    panel.send()
    panel.draw()
    assert panel.ball.position is None


def test_the_words():
    live = Live(configuration=ARM)
    assert 'no tip controller is heard' in tip_control_html(live, None)
    now = time.monotonic()

    def says(level, message, **values):
        live.hear({'tip_controller: tip': Diagnostic(level, message, values, now)})

    says(0, 'stopped', state='STOPPED')
    text = tip_control_html(live, None)
    assert 'stopped' in text
    assert 'no target yet' in text
    says(2, 'hold: IMU <2> is frozen', state='HOLD', left_mm='0.0')
    live.hear({'estimator: sweeps': Diagnostic(0, '100 Hz', {}, now)})
    live.backbones['pcc_delta'] = np.array(
        [[0.0] * 7, [*(NEAR + np.array([0.003, 0.0, 0.004])), 0.0, 0.0, 0.0, 1.0]]
    )
    text = tip_control_html(live, NEAR)
    assert 'hold: IMU &lt;2&gt; is frozen' in text
    assert 'target +0.050 +0.030 +0.150 m' in text
    assert 'tip 5.0 mm off' in text
    assert 'true tip' not in text
    assert 'no target yet' not in text
    live.truth_tip = NEAR + np.array([0.0, 0.012, 0.0])
    assert 'true tip 12.0 mm off' in tip_control_html(live, NEAR)
