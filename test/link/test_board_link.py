import threading

import numpy as np
import pytest

from sesa2.link.board_link import BoardLink
from sesa2.link.link_errors import LinkError, ProtocolVersionError
from sesa2.link.packets import State
from sesa2.link.session import LinkSettings
from sesa2.link.status import Level
from sesa2.sensing.imu.bno055.offsets import Offsets

IDS = (1, 2, 3, 4)
ACCELERATION = 2
SAVED = {i: Offsets((i, 2, 3), (4, 5, 6), (7, 8, 9), 1000, 480) for i in IDS}


class Sweeps:
    """Notes what a link tells, in place of the recorder of a session."""

    def __init__(self, recorder):
        self._recorder = recorder
        self.first = threading.Event()
        self.at_first = lambda: None

    def on_sweep(self, data, stamps_ns, accelerations):
        if not self.first.is_set():
            self.first.set()
            self.at_first()
        self._recorder.on_data(data, (stamps_ns, accelerations))

    def on_offsets(self, imu_id, offsets):
        self._recorder.on_offsets(imu_id, offsets)

    def on_event(self, event):
        self._recorder.on_event(event)


@pytest.fixture
def sweeps(recorder):
    return Sweeps(recorder)


@pytest.fixture
def make_link(sweeps, tmp_path):
    """Starts a link, which ends with the test."""
    links = []

    def make(**settings):
        link = BoardLink(LinkSettings(str(tmp_path / 'board'), IDS, **settings), sweeps, SAVED)
        links.append(link)
        link.start()
        return link

    yield make
    for link in links:
        link.close()


def test_sweeps_come_out_and_it_ends(make_board, make_link, recorder):
    make_board()
    link = make_link()
    recorder.wait_for_sweeps(20)
    data, (stamps_ns, accelerations) = recorder.data[-1]
    assert len(stamps_ns) == len(data.sweep.ids) == 4
    assert accelerations is None
    link.close()
    assert link.finished
    assert link.failure is None


def test_accelerations_are_those_of_their_sweep(make_board, make_link, recorder):
    make_board()
    make_link(acceleration=True)
    recorder.wait(lambda: recorder.data and recorder.data[-1][0].states == [State.RUN] * 4)
    recorder.wait_for_sweeps(20)
    seqs = [data.sweep.seq for data, _ in recorder.data]
    assert seqs == list(range(seqs[0], seqs[0] + len(seqs)))
    for data, (_, accelerations) in recorder.data[-20:]:
        running = np.array(data.states) == State.RUN
        assert running.any()
        np.testing.assert_allclose(np.linalg.norm(accelerations[running], axis=1), 9.80665, atol=0.02)


def test_a_sweep_whose_acceleration_is_lost_comes_out_without(make_board, make_link, recorder):
    virtual = make_board()
    make_link(acceleration=True)
    recorder.wait_for_sweeps(10)
    harmed, lost = virtual._harmed, []

    def lose_accelerations(frame):
        if frame[1] != ACCELERATION or len(lost) == 3:
            return harmed(frame)
        lost.append(frame)
        return b''

    virtual._harmed = lose_accelerations
    recorder.wait(lambda: len(lost) == 3)
    recorder.wait_for_sweeps(5)
    assert sum(accelerations is None for _, (_, accelerations) in recorder.data) == 3
    stamps = [stamps_ns for _, (stamps_ns, _) in recorder.data]
    assert (np.diff(stamps, axis=0) > 0).all()


def test_a_board_that_never_was_there_is_a_failure(make_link, recorder):
    link = make_link()
    recorder.wait(lambda: link.finished)
    assert isinstance(link.failure, LinkError)
    assert not link.was_up
    assert not recorder.messages()


def test_a_board_lost_while_it_is_being_set_up_is_waited_for(make_board, make_link, recorder, sweeps):
    """The first sweeps come before the offsets have been compared: from then on the port is the right one."""
    virtual = make_board()
    sweeps.at_first = virtual.unplug_cable
    link = make_link()
    recorder.wait_for_event('was lost')
    assert not link.finished
    virtual.plug_cable()
    recorder.wait_for_sweeps(20)
    assert link.failure is None


def test_a_board_of_another_version_ends_it_and_is_told_of(make_board, make_link, recorder):
    first = make_board()
    link = make_link()
    recorder.wait_for_sweeps(5)
    recorder.wait(lambda: link.session.connected)
    first.close()
    make_board(version=9)
    recorder.wait(lambda: link.finished)
    assert isinstance(link.failure, ProtocolVersionError)
    assert any('this link has ended' in message for message in recorder.messages(Level.ERROR))
