"""The simulated board itself: what the other tests stand on."""

import time

import pytest
from simulated_board import SimulatedBoard, SimulatorError

from sesa2.link import board_client as link_board
from sesa2.link.framing import encode_frame
from sesa2.link.packets import Data, State
from sesa2.link.requests import BoardConfiguration, Command, FusionMode, Request, Stream
from sesa2.link.serial_port import SerialPort

CONFIGURE = encode_frame(
    Request(Command.CONFIGURE, 1, BoardConfiguration(0xFF, 100, FusionMode.NDOF, 0).pack()).encode()
)
STREAM = encode_frame(Request(Command.STREAM, 2, bytes((Stream.QUATERNIONS,))).encode())


def record(step_s):
    with SimulatedBoard() as simulated:
        simulated.set_pattern()
        simulated.run(0.7)
        received = simulated.run(0.01, CONFIGURE) + simulated.run(0.01, STREAM)
        end_us = simulated.now_us + 1e6
        while simulated.now_us < end_us:
            received += simulated.run(step_s)
        return received


@pytest.mark.usefixtures('built')
def test_the_same_commands_give_the_same_bytes_however_time_is_cut():
    whole = record(1.0)
    assert len(whole) > 9000
    assert record(1.0) == whole
    assert record(0.001) == whole


@pytest.mark.usefixtures('built')
@pytest.mark.parametrize(
    'line', ['', 'fly', 'run', 'quaternion 9 1 2 3 4', 'unplug 8', 'hold nowhere sda', 'mode 1 2']
)
def test_a_command_that_makes_no_sense_is_refused(line):
    with SimulatedBoard() as simulated:
        with pytest.raises(SimulatorError):
            simulated.command(line)
        assert simulated.run(0.01) == b''


@pytest.mark.usefixtures('built')
def test_a_pulled_cable_loses_bytes_and_a_new_one_works():
    with SimulatedBoard() as simulated:
        simulated.run(0.7)
        simulated.run(0.1, CONFIGURE)
        simulated.run(0.1, STREAM)
        simulated.command('cable', 0)
        simulated.command('run', 500000)
        simulated.command('cable', 1)
        port = SerialPort(simulated.port_path, 500000)  # throws away what came before it
        simulated.command('run', 100000)
        assert len(port.read(10.0)) > 0
        port.close()


@pytest.mark.usefixtures('built')
def test_in_real_time_the_board_streams_by_itself():
    """No figure of time here: only that it goes, and that the link's own port and clock do for it."""
    with SimulatedBoard(real_time=True) as simulated:
        packets = []
        port = SerialPort(simulated.port_path, 500000)
        client = link_board.Board(port, lambda packet, _: packets.append(packet))
        client.hello(patience_s=30.0)
        client.configure(BoardConfiguration(0xFF, 100, FusionMode.NDOF, 0))
        client.stream(Stream.QUATERNIONS)
        deadline = time.monotonic() + 30.0
        while not any(isinstance(packet, Data) and set(packet.states) == {State.RUN} for packet in packets):
            assert time.monotonic() < deadline
            client.poll(0.1)
        port.close()
        with pytest.raises(SimulatorError, match='time runs by itself'):
            simulated.command('run', 1000)


@pytest.mark.usefixtures('built')
def test_the_simulator_ends_with_its_test():
    simulated = SimulatedBoard()
    process, control = simulated._process, simulated._control
    simulated._answers.close()
    control.close()
    assert process.wait(30) == 0
    simulated._folder.cleanup()
