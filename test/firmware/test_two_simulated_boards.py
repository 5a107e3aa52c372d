"""One serial bridge on two boards with the real firmware, in real time: sixteen IMUs, each at its own id."""

import numpy as np
import pytest
from graph_fixtures import ros_graph
from sensor_msgs.msg import Imu
from simulated_board import CHANNELS, SimulatedBoard

from sesa2.configuration import validate
from sesa2.nodes.serial_bridge import SerialBridge
from sesa2.ros.parameters import overrides
from sesa2.ros.qos import STREAM
from sesa2.sensing.imu.bno055.offsets import Offsets, save_offsets

IDS = range(1, 17)
OF_BOARD = (range(1, 9), range(9, 17))
QUATERNIONS = {i: (8192, -8192 + i, 8192 + i, 8192 - i) for i in IDS}
"""What the chips show, raw, w x y z: told apart by their last digits."""
SAVED = {i: Offsets((i, -2, 3), (-400, 500 + i, -600), (1, -1, i), 1000, 480 + i) for i in IDS}
OFFSETS_REGISTER = 0x55


class Bench:
    """Two ports, each with a simulated board on it that can be killed and replaced, and a bridge on both."""

    def __init__(self, graph, folder):
        self.graph = graph
        self.ports = [folder / 'port0', folder / 'port1']
        self.boards = [None, None]
        for number in (0, 1):
            self.put_on(number)
        for i in IDS:
            save_offsets(folder / 'offsets.yaml', i, SAVED[i])
        values = {
            'arm': {'length': 1.3},
            'imus': {'ids': list(IDS), 'positions': [0.08 * i for i in IDS]},
            'serial': {'ports': [str(port) for port in self.ports]},
            'calibration': {'file': str(folder / 'offsets.yaml')},
        }
        self.bridge = graph.add(SerialBridge(parameter_overrides=overrides(validate(values))))
        self.messages = {i: graph.listen(Imu, f'imu_{i}/data', STREAM) for i in IDS}

    def put_on(self, number):
        """A board that has just been given power."""
        board = self.boards[number] = SimulatedBoard(real_time=True)
        for channel, i in zip(CHANNELS, OF_BOARD[number], strict=True):
            board.set_quaternion(channel, QUATERNIONS[i])
        self.ports[number].unlink(missing_ok=True)
        self.ports[number].symlink_to(board.port_path)

    def kill(self, number):
        """Its power and its cable are gone."""
        self.boards[number].close()
        self.boards[number] = None

    def heard(self, ids, count=30):
        """Wait until all of some IMUs have been heard so often from now on."""
        before = {i: len(self.messages[i]) for i in ids}
        self.graph.until(
            lambda: all(len(self.messages[i]) >= before[i] + count for i in ids), f'IMUs {list(ids)}'
        )

    def assert_right_at_their_ids(self):
        for i in IDS:
            q = np.array(
                [[m.orientation.w, *map(m.orientation.__getattribute__, 'xyz')] for m in self.messages[i]]
            )
            np.testing.assert_array_equal(q * 16384, np.tile(QUATERNIONS[i], (len(q), 1)))

    def assert_offsets_on_chips(self):
        """As saved for each id, in the registers themselves."""
        for number, ids in enumerate(OF_BOARD):
            for channel, i in zip(CHANNELS, ids, strict=True):
                registers = self.boards[number].registers(channel, OFFSETS_REGISTER, 22)
                assert registers == SAVED[i].to_registers(), f'IMU {i}'

    def close(self):
        for board in self.boards:
            if board:
                board.close()


@pytest.fixture
def bench(built, tmp_path):
    with ros_graph() as graph:
        one = Bench(graph, tmp_path)
        yield one
        graph.remove(one.bridge)
        one.close()


def test_sixteen_imus_on_two_boards_and_one_board_killed_and_back(bench):
    bench.heard(IDS)
    bench.assert_right_at_their_ids()
    bench.assert_offsets_on_chips()
    for number, other in ((1, 0), (0, 1)):
        bench.kill(number)
        link = bench.bridge.links[number]
        bench.graph.until(lambda link=link: not link.session.connected, 'a noticed loss')
        bench.heard(OF_BOARD[other])  # what the lost board said last may still be on its way
        silent = {i: len(bench.messages[i]) for i in OF_BOARD[number]}
        bench.heard(OF_BOARD[other], 100)
        assert {i: len(bench.messages[i]) for i in OF_BOARD[number]} == silent
        assert bench.bridge.failure is None
        bench.put_on(number)
        bench.heard(IDS)
    bench.assert_right_at_their_ids()
    bench.assert_offsets_on_chips()
    counted = [link.session.counters() for link in bench.bridge.links]
    assert [c.reconnects for c in counted] == [1, 1]
    assert [c.offset_differences for c in counted] == [0, 0]
