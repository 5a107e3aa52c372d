import os
import time

import numpy as np
import pytest

from sesa2.link.board_client import Board
from sesa2.link.link_errors import LinkError
from sesa2.link.packets import State
from sesa2.link.requests import BoardConfiguration, FusionMode, Stream
from sesa2.link.serial_port import SerialPort
from sesa2.sensing.imu.addresses import mask_of


def stream(virtual, count):
    """Packets of the virtual board, with their arrival, until all IMUs have run for a number of sweeps."""
    port = SerialPort(virtual.path, 500_000)
    packets = []
    board = Board(port, lambda packet, arrival_ns: packets.append((packet, arrival_ns)))
    board.hello()
    board.configure(BoardConfiguration(mask_of(virtual.arm.ids), 100, FusionMode.NDOF, 0))
    board.stream(Stream.QUATERNIONS)
    running = []
    while len(running) < count:
        board.poll(1)
        running = [pair for pair in packets if all(state is State.RUN for state in pair[0].states)]
    port.close()
    return running


def test_truth_at_the_boards_own_time(make_board):
    virtual = make_board()
    for data, _ in stream(virtual, 30):
        t = [virtual.motion_time_of(data.sweep.t_us + read_ns / 1000) for read_ns in data.sweep.read_ns()]
        truth = virtual.truth(np.array(t))[np.arange(4), np.arange(4)]
        np.testing.assert_allclose(data.orientations, truth, rtol=0, atol=2**-15 + 1e-6)


def test_a_sweep_arrives_after_it_was_measured_and_its_time_on_the_line(make_board):
    virtual = make_board()
    for data, arrival_ns in stream(virtual, 30):
        late = virtual.motion_time(arrival_ns) - virtual.motion_time_of(data.sweep.t_us)
        assert late > 4 * 450e-6 + 55 * 20e-6 - 1e-6


def test_link(make_board, tmp_path):
    virtual = make_board()
    link = tmp_path / 'board'
    assert virtual.path == str(link)
    first = link.readlink()
    held = os.open(first, os.O_RDWR | os.O_NOCTTY)  # so that the next one gets another name
    virtual.unplug_cable()
    assert not link.is_symlink()
    virtual.plug_cable()
    assert link.readlink() != first
    assert link.exists()
    os.close(held)
    virtual.close()
    assert not link.is_symlink()
    virtual.close()


def test_without_a_link(make_board):
    virtual = make_board(link=None)
    assert virtual.path.startswith('/dev/')
    assert stream(virtual, 3)


def test_a_stale_link_is_replaced_but_no_file(make_board, tmp_path):
    (tmp_path / 'stale').symlink_to('/dev/nowhere')
    assert stream(make_board(link=tmp_path / 'stale'), 3)
    (tmp_path / 'file').write_text('precious')
    with pytest.raises(LinkError, match='no symbolic link'):
        make_board(link=tmp_path / 'file')
    assert (tmp_path / 'file').read_text() == 'precious'


def test_nobody_reads(make_board):
    """What does not fit into the terminal is dropped and counted; the next reader gets whole frames again."""
    virtual = make_board()
    stream(virtual, 3)
    port = SerialPort(virtual.path, 500_000)
    packets = []
    board = Board(port, lambda packet, arrival_ns: packets.append(packet))
    deadline = time.monotonic() + 30
    while virtual._firmware.tx_dropped < 10 and time.monotonic() < deadline:
        time.sleep(0.05)
    while board.poll(0.001):
        pass
    stats = board.stats()
    assert stats.tx_dropped >= 10
    assert board.decoder.errors.total == 0
    assert len(packets) > 20
    port.close()
