import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sesa2.link.link_errors import CommandError, LinkError, ProtocolVersionError
from sesa2.link.packets import State
from sesa2.link.requests import Command, FusionMode, Hello, Result
from sesa2.link.serial_port import SerialPort
from sesa2.link.session import LinkSettings, Session
from sesa2.link.status import Level, OffsetsState
from sesa2.link.virtual.motion import ArmMotion
from sesa2.link.virtual.virtual_arm import VirtualArm
from sesa2.sensing.imu.bno055.offsets import Offsets

IDS = (1, 2, 3, 4)
SAVED = {
    imu_id: Offsets((imu_id, 2, 3), (4, 5, 6), (7, 8, 9), 1000, 480) for imu_id in (1, 2, 4)
}  # none of IMU 3


@pytest.fixture
def make_session(recorder, tmp_path):
    """A function that makes a session; its `run` is in a thread that ends with the test."""
    running = []

    def make(saved=None, connect=True, **settings):
        session = Session(
            LinkSettings(str(tmp_path / 'board'), IDS, **settings),
            recorder,
            SAVED if saved is None else saved,
        )
        if connect:
            session.connect()
        thread = threading.Thread(target=session.run)
        thread.start()
        running.append((session, thread))
        return session

    yield make
    for session, thread in running:
        session.stop()
        thread.join(30)
        assert not thread.is_alive()


def states(session):
    return [imu.state for imu in session.imus().values()]


RUN = [State.RUN] * 4


def test_connect_streams_and_checks_offsets(make_board, make_session, recorder):
    virtual = make_board()
    session = make_session()
    recorder.wait_for_sweeps(50)
    assert session.connected
    assert dict(recorder.offsets) == SAVED
    assert [imu.offsets for imu in session.imus().values()] == [
        OffsetsState.AS_SAVED,
        OffsetsState.AS_SAVED,
        OffsetsState.NONE_SAVED,
        OffsetsState.AS_SAVED,
    ]
    for imu_id, offsets in SAVED.items():
        assert virtual._chips[imu_id].read_offsets() == offsets.to_registers()
    counters = session.counters()
    assert counters.sweeps == len(recorder.data) or counters.sweeps == len(recorder.data) + 1
    assert (counters.lost_sweeps, counters.frame_errors.total, counters.malformed, counters.reconnects) == (
        0,
        0,
        0,
        0,
    )
    recorder.wait(lambda: session.stats.sweeps > 0)
    assert recorder.messages(Level.WARN) == recorder.messages(Level.ERROR) == []


def test_stamps_lead_to_the_truth(make_board, make_session, recorder):
    """Stamp → time of the motion → orientation; how exactly depends on how busy this machine is."""
    virtual = make_board()
    session = make_session(saved={})
    recorder.wait(lambda: states(session) == RUN)
    recorder.wait_for_sweeps(200)
    offset_ns = session._intake.wall.of(0)
    errors_ms = [
        1e3 * (virtual.motion_time(stamps_ns[0] - offset_ns) - virtual.motion_time_of(data.sweep.t_us + 225))
        for data, stamps_ns in recorder.data[-100:]
    ]
    assert min(errors_ms) > -0.01  # nothing is stamped before it was measured
    assert max(errors_ms) < 50
    for _, stamps_ns in recorder.data:
        np.testing.assert_array_equal(np.diff(stamps_ns), 450_000)
    assert np.diff([stamps_ns[0] for _, stamps_ns in recorder.data]).min() >= 4.9e6


def test_acceleration(make_board, make_session, recorder):
    make_board()
    make_session(acceleration=True)
    recorder.wait(lambda: len(recorder.accelerations) > 20)
    stamps = {data.sweep.seq: stamps_ns for data, stamps_ns in recorder.data}
    shared = [
        (stamps_ns, stamps[a.sweep.seq]) for a, stamps_ns in recorder.accelerations if a.sweep.seq in stamps
    ]
    assert len(shared) > 10
    assert all(of_acceleration == of_data for of_acceleration, of_data in shared)


def test_commands_from_another_thread(make_board, make_session, recorder):
    virtual = make_board()
    session = make_session()
    assert session.submit(lambda board: board.read_offsets(4)).result(30) == SAVED[4]
    virtual.unplug(3)
    recorder.wait_for_event('IMU 3 does not answer')
    with pytest.raises(CommandError, match='IMU 3: the chip is absent'):
        session.submit(lambda board: board.read_offsets(3)).result(30)
    before = len(recorder.data)
    recorder.wait_for_sweeps(10)
    assert len(recorder.data) > before


def test_lost_and_damaged_packets_are_counted(make_board, make_session, recorder):
    virtual = make_board()
    session = make_session(saved={})
    recorder.wait_for_sweeps(10)
    virtual.corrupt_frames(3)
    recorder.wait(lambda: session.counters().lost_sweeps >= 2)  # a reply may be among what is damaged
    virtual.lose_bytes(200)
    recorder.wait(lambda: session.counters().lost_sweeps >= 5)
    recorder.wait_for_sweeps(10)
    counters = session.counters()
    seqs = np.unwrap([data.sweep.seq for data, _ in recorder.data], period=1 << 16)
    assert counters.lost_sweeps == seqs[-1] - seqs[0] + 1 - len(seqs)
    assert counters.frame_errors.total >= 2


def test_an_imu_comes_back_with_its_offsets(make_board, make_session, recorder):
    virtual = make_board()
    session = make_session()
    recorder.wait(lambda: states(session) == RUN)
    virtual.unplug(2)
    recorder.wait_for_event('IMU 2 does not answer')
    recorder.wait_for_sweeps(3)
    assert states(session) == [State.RUN, State.ABSENT, State.RUN, State.RUN]
    virtual.plug(2)
    recorder.wait_for_event('IMU 2 is back; offsets: as saved')
    recorder.wait(lambda: states(session) == RUN)
    counters = session.counters()
    assert (counters.comebacks, counters.lost_sweeps, counters.offset_differences) == (1, 0, 0)


def test_other_offsets_than_saved_are_told(make_board, make_session, recorder, monkeypatch):
    virtual = make_board()
    session = make_session()
    recorder.wait(lambda: states(session) == RUN)
    wrong = replace(SAVED[2], mag_radius=1)
    chip = virtual._chips[2]
    monkeypatch.setattr(chip, 'read_offsets', wrong.to_registers)
    virtual.unplug(2)
    recorder.wait_for_event('IMU 2 does not answer')
    virtual.plug(2)
    recorder.wait_for_event('IMU 2 is back; offsets: different from those saved')
    recorder.wait_for_event('IMU 2 works with other offsets than saved')
    assert session.counters().offset_differences == 1
    assert session.imus()[2].offsets is OffsetsState.DIFFERENT
    assert (2, wrong) in recorder.offsets


def test_an_absent_imu_at_the_start(make_board, make_session, recorder):
    virtual = make_board()
    virtual.unplug(4)
    session = make_session()
    recorder.wait_for_event('IMU 4 is absent; the board keeps its offsets')
    recorder.wait_for_event('IMU 4 does not answer')
    assert session.imus()[4].offsets is OffsetsState.NOT_CHECKED
    virtual.plug(4)
    recorder.wait_for_event('IMU 4 is back; offsets: as saved')


def test_imu_mode_asks_for_a_new_alignment(make_board, make_session, recorder):
    virtual = make_board()
    session = make_session(fusion=FusionMode.IMU)
    recorder.wait(lambda: states(session) == RUN)
    assert not any('align again' in message for message in recorder.messages())
    virtual.unplug(2)
    recorder.wait_for_event('IMU 2 does not answer')
    virtual.plug(2)
    recorder.wait_for_event('IMU 2 is back with a new heading, since mode IMU has no north: align again')
    virtual.reset()
    recorder.wait_for_event('the chips start with new headings')


def test_board_reset(make_board, make_session, recorder):
    virtual = make_board()
    session = make_session()
    recorder.wait_for_sweeps(100)
    virtual.reset()
    recorder.wait_for_event('the board was reset')
    recorder.wait_for_sweeps(20)
    counters = session.counters()
    assert (counters.board_resets, counters.reconnects, counters.stalls) == (1, 0, 0)
    assert counters.silent_s > 0.25
    assert session.imus()[1].offsets is OffsetsState.AS_SAVED
    stamps = [stamps_ns[0] for _, stamps_ns in recorder.data]
    assert np.diff(stamps).min() > 0


def test_board_that_hangs_and_goes_on(make_board, make_session, recorder):
    virtual = make_board()
    session = make_session(saved={})
    recorder.wait_for_sweeps(10)
    virtual.mute()
    recorder.wait(lambda: not session.connected)
    virtual.unmute()
    recorder.wait(lambda: session.connected)
    recorder.wait_for_sweeps(20)
    counters = session.counters()
    assert counters.board_resets == 0
    assert counters.stalls + counters.reconnects >= 1


def test_cable_is_pulled_and_put_back(make_board, make_session, recorder):
    virtual = make_board()
    session = make_session()
    recorder.wait_for_sweeps(10)
    for count in (1, 2):
        errors = len(recorder.messages(Level.ERROR))
        virtual.unplug_cable()
        recorder.wait(lambda errors=errors: len(recorder.messages(Level.ERROR)) >= errors + 2)
        lost, absent = recorder.messages(Level.ERROR)[errors : errors + 2]
        assert 'was lost' in lost
        assert 'is not there' in absent
        with pytest.raises(LinkError):
            session.submit(lambda board: board.stats()).result(30)
        virtual.plug_cable()
        recorder.wait(lambda count=count: session.counters().reconnects == count)
        recorder.wait_for_sweeps(20)
        assert len(recorder.messages(Level.ERROR)) == errors + 2  # said once, tried often
        recorder.wait(lambda: session.imus()[2].offsets is OffsetsState.AS_SAVED)  # the chips start too
    assert session.counters().board_resets == 2


def test_offsets_are_looked_up_at_every_connect(make_board, make_session, recorder):
    virtual = make_board()
    saved = dict(SAVED)
    make_session(saved)
    recorder.wait_for_sweeps(5)
    saved[3] = replace(SAVED[1], accel_radius=77)
    virtual.reset()
    recorder.wait(lambda: (3, saved[3]) in recorder.offsets)


def test_offsets_saved_meanwhile_are_checked(make_board, make_session, recorder):
    # A chip without offsets works with others as soon as it has learnt its own; this one learns nothing meanwhile.
    virtual = make_board(calibration_s=3600.0)
    saved = dict(SAVED)
    session = make_session(saved)
    recorder.wait_for_sweeps(5)
    saved[3] = Offsets.from_registers(virtual._chips[3].read_offsets())
    recorder.wait(lambda: session.imus()[3].offsets is OffsetsState.AS_SAVED)


def test_offsets_that_the_board_refuses_end_nothing(make_board, make_session, recorder):
    virtual = make_board()
    visit = virtual._firmware._visit

    def refuse(request, now_us):
        if request.command is Command.WRITE_OFFSETS and request.arguments[0] + 1 == 2:
            virtual._firmware._reply(request, Result.I2C_ERROR)
        else:
            visit(request, now_us)

    virtual._firmware._visit = refuse
    session = make_session()
    recorder.wait(lambda: states(session) == RUN)
    recorder.wait(lambda: session.imus()[2].offsets is OffsetsState.DIFFERENT)
    assert session.imus()[4].offsets is OffsetsState.AS_SAVED
    [refused] = recorder.messages(Level.ERROR)
    assert 'WRITE_OFFSETS of IMU 2' in refused
    recorder.wait_for_sweeps(20)
    counters = session.counters()
    assert (counters.reconnects, counters.stalls, counters.board_resets) == (0, 0, 0)


def test_offsets_that_cannot_be_read_end_nothing(make_board, make_session, recorder):
    virtual = make_board()
    visit = virtual._firmware._visit

    def refuse(request, now_us):
        if request.command is Command.READ_OFFSETS and request.arguments[0] + 1 == 2:
            virtual._firmware._reply(request, Result.I2C_ERROR)
        else:
            visit(request, now_us)

    virtual._firmware._visit = refuse
    session = make_session()
    recorder.wait_for_event('offsets not checked: READ_OFFSETS of IMU 2')
    recorder.wait(lambda: states(session) == RUN)
    assert session.imus()[2].offsets is OffsetsState.NOT_CHECKED
    virtual._firmware._visit = visit
    recorder.wait(lambda: session.imus()[2].offsets is OffsetsState.AS_SAVED)
    assert session.counters().reconnects == 0
    assert recorder.messages(Level.ERROR) == []


WRAP_MS = 1 << 32


@pytest.mark.parametrize(
    ('first_ms', 'passed_s', 'second_ms', 'reset'),
    [
        (1_000_000, 10.0, 1_010_000, False),
        (1_000_000, 10.0, 1_010_090, False),  # a board that is 0.9 % fast
        (1_000_000, 10.0, 1_009_910, False),  # and one that is 0.9 % slow
        (1_000_000, 10.0, 9_200, True),
        (2_000, 100.0, 50_000, True),  # older than its predecessor was, and younger than that would be
        (WRAP_MS - 5_000, 10.0, 5_000, False),
        (WRAP_MS - 5_000, 10.0, 5_090, False),
        (WRAP_MS - 5_000, 10.0, 4_910, False),
        (WRAP_MS - 9_950, 10.0, WRAP_MS - 40, False),
        (WRAP_MS - 5_000, 10.0, 2_000, True),
    ],
)
def test_a_reset_shows_by_an_uptime_that_is_short(
    recorder, monkeypatch, first_ms, passed_s, second_ms, reset
):
    """Said by no board: none can be waited for that has run for 49.7 days."""
    session = Session(LinkSettings('nowhere', IDS), recorder, {})
    now_s = 500.0
    monkeypatch.setattr('sesa2.link.session.time', SimpleNamespace(monotonic=lambda: now_s))
    assert not session._greet(SimpleNamespace(hello=lambda: Hello(1, 0, 15, first_ms)))
    now_s += passed_s
    assert session._greet(SimpleNamespace(hello=lambda: Hello(1, 0, 15, second_ms))) == reset
    assert session.counters().board_resets == reset


def test_the_wrap_of_the_uptime_is_no_reset(make_board, make_session, recorder):
    """After 49.7 days the board's milliseconds begin again at 0; so they do three seconds into this test."""
    virtual = make_board()
    wrap_us = 1000 << 32
    virtual._do(lambda: virtual._start(3_000_000 - wrap_us))
    session = make_session(saved={})
    recorder.wait_for_sweeps(10)
    assert session.hello.uptime_ms > 1 << 31
    virtual.mute()
    recorder.wait(lambda: not session.connected)
    recorder.wait(lambda: virtual._now_us() - virtual._born_us > wrap_us)
    virtual.unmute()
    recorder.wait(lambda: session.connected)
    recorder.wait_for_sweeps(10)
    assert session.hello.uptime_ms < 100_000
    counters = session.counters()
    assert counters.board_resets == 0
    assert counters.stalls + counters.reconnects >= 1


def test_a_board_of_another_version_ends_it(make_board, make_session, recorder):
    make_board(version=9)
    with pytest.raises(ProtocolVersionError, match='version 9'):
        make_session()


def test_a_board_of_another_version_after_a_reconnect_ends_run(make_board, recorder, tmp_path):
    first = make_board()
    session = Session(LinkSettings(str(tmp_path / 'board'), IDS), recorder, {})
    session.connect()
    first.close()
    make_board(version=9)
    with pytest.raises(ProtocolVersionError, match='version 9'):
        session.run()
    with pytest.raises(LinkError, match='closed'):
        session.submit(lambda board: board.stats()).result(30)


def test_first_failure_is_raised(recorder, make_board, tmp_path):
    session = Session(LinkSettings(str(tmp_path / 'nowhere'), IDS), recorder, {})
    with pytest.raises(LinkError, match='is not there'):
        session.connect()
    virtual = make_board()
    port = SerialPort(virtual.path, 500_000)
    with pytest.raises(LinkError, match='held by another program'):
        Session(LinkSettings(virtual.path, IDS), recorder, {}).connect()
    port.close()


def test_run_waits_for_a_port_that_comes_later(make_board, make_session, recorder):
    session = make_session(connect=False)
    recorder.wait_for_event('is not there')
    make_board()
    recorder.wait_for_sweeps(10)
    assert session.counters().reconnects == 0


def test_stop_ends_a_wait_for_a_board(make_board, make_session, recorder):
    """The fixture stops a session that says HELLO to nobody."""
    virtual = make_board()
    virtual.mute()
    make_session(connect=False)


def test_the_board_is_silent_after_the_end(make_board, recorder, tmp_path):
    virtual = make_board()
    session = Session(LinkSettings(virtual.path, IDS), recorder, {})
    session.connect()
    thread = threading.Thread(target=session.run)
    thread.start()
    recorder.wait_for_sweeps(5)
    session.stop()
    thread.join(30)
    recorder.wait(lambda: virtual._firmware._flags == 0)


def test_an_older_firmware_is_told_of_and_used(make_board, make_session, recorder):
    make_board(release=(0, 9))
    session = make_session()
    recorder.wait_for_sweeps(10)
    [message] = [m for m in recorder.messages(Level.WARN) if 'firmware' in m]
    assert 'the board has firmware 0.9, this package comes with 1.1' in message
    assert '(make -C firmware upload)' in message
    assert session.hello.outdated


@pytest.mark.parametrize('release', [(1, 1), (1, 2), (2, 0)])
def test_a_firmware_that_is_not_older_is_not_told_of(make_board, make_session, recorder, release):
    make_board(release=release)
    make_session()
    recorder.wait_for_sweeps(10)
    assert not [m for m in recorder.messages(Level.WARN) if 'firmware' in m]


def test_a_session_of_the_second_board(make_board, recorder):
    ids = (9, 10, 12)
    virtual = make_board(arm=VirtualArm(ids, ArmMotion([0.1, 0.2, 0.3])), number=1)
    saved = {imu_id: Offsets((imu_id, 2, 3), (4, 5, 6), (7, 8, 9), 1000, 480) for imu_id in (1, 2, 9, 12)}
    session = Session(LinkSettings(virtual.path, ids), recorder, saved)
    session.connect()
    thread = threading.Thread(target=session.run)
    thread.start()
    recorder.wait(lambda: len(session.imus()) == 3 and states(session) == [State.RUN] * 3)
    assert {imu_id: imu.offsets for imu_id, imu in session.imus().items()} == {
        9: OffsetsState.AS_SAVED,
        10: OffsetsState.NONE_SAVED,
        12: OffsetsState.AS_SAVED,
    }
    assert dict(recorder.offsets) == {9: saved[9], 12: saved[12]}
    assert recorder.data[-1][0].sweep.ids == ids
    virtual.unplug(10)
    recorder.wait_for_event('IMU 10 does not answer')
    virtual.plug(10)
    recorder.wait_for_event('IMU 10 is back')
    session.stop()
    thread.join(30)
