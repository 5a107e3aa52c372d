import numpy as np
import pytest

from sesa2.link.board_client import Board
from sesa2.link.framing import encode_frame
from sesa2.link.link_errors import CommandError, LinkError, ProtocolVersionError
from sesa2.link.packets import State
from sesa2.link.requests import BoardConfiguration, FusionMode, Stream
from sesa2.link.serial_port import SerialPort
from sesa2.link.virtual.motion import ArmMotion
from sesa2.link.virtual.virtual_arm import VirtualArm
from sesa2.sensing.imu.addresses import mask_of
from sesa2.sensing.imu.bno055.offsets import Offsets

OFFSETS = Offsets((1, 2, 3), (4, 5, 6), (7, 8, 9), 10, 11)
MASK = mask_of((1, 2, 3, 4))


@pytest.fixture
def connect(make_board):
    """A function that makes a virtual board and a client on it; the client's packets are noted in ``packets``."""
    ports = []

    def connect(baud=500_000, **options):
        virtual = make_board(**options)
        ports.append(SerialPort(virtual.path, baud))
        packets = []
        board = Board(ports[-1], lambda packet, arrival_ns: packets.append((packet, arrival_ns)))
        return virtual, board, packets

    yield connect
    for port in ports:
        port.close()


def start(board, packets, count=20):
    board.hello()
    board.configure(BoardConfiguration(MASK, 100, FusionMode.NDOF, 0))
    board.stream(Stream.QUATERNIONS)
    poll(board, lambda: len(packets) >= count and packets[-1][0].states == [State.RUN] * 4)


def poll(board, done):
    for _ in range(2000):
        if done():
            return
        board.poll(0.05)
    raise AssertionError('polled in vain')


def test_every_command(connect):
    _, board, packets = connect()
    hello = board.hello()
    assert (hello.firmware_major, hello.channels) == (1, MASK)
    assert not board.write_offsets(2, OFFSETS)  # in no use before CONFIGURE; the board keeps them
    start(board, packets)
    assert board.read_offsets(2) == OFFSETS
    assert board.stats().sweeps >= 20
    board.reset_imu(3)
    poll(board, lambda: packets[-1][0].states[2] is State.ABSENT)
    poll(board, lambda: packets[-1][0].states[2] is State.RUN)
    assert board.stats().comebacks[2] == 1
    board.stream(Stream.STOP)
    packets.clear()
    board.stats()
    assert not packets


def test_packets_that_arrive_while_a_command_waits_are_not_lost(connect):
    _, board, packets = connect()
    start(board, packets)
    for _ in range(5):
        for imu_id in (1, 2, 3, 4):
            board.read_offsets(imu_id)
    seqs = [packet.sweep.seq for packet, _ in packets]
    assert len(seqs) > 50
    assert seqs == list(range(seqs[0], seqs[0] + len(seqs)))
    arrivals = [arrival_ns for _, arrival_ns in packets]
    assert arrivals == sorted(arrivals)


def test_a_lost_reply_is_asked_for_again(connect):
    virtual, board, _ = connect()
    board.hello()
    virtual.lose_bytes(5)
    assert board.stats().rx_bad == 0
    assert board.retries == 1
    virtual.corrupt_frames(2)
    board.stats()
    assert board.retries == 3
    assert board.decoder.errors.total >= 2


def test_hello_waits_for_the_boot(connect):
    virtual, board, _ = connect()
    virtual.reset()
    assert board.hello().uptime_ms < 20_000


def test_a_busy_chip_is_waited_for(connect):
    _, board, packets = connect()
    start(board, packets)
    assert board.write_offsets(2, OFFSETS)
    assert packets[-1][0].states[1] is not State.RUN
    assert board.read_offsets(2) == OFFSETS
    assert board.retries == 0


def test_absent(connect):
    virtual, board, packets = connect()
    start(board, packets)
    virtual.unplug(2)
    poll(board, lambda: packets[-1][0].states[1] is State.ABSENT)
    assert board.write_offsets(2, OFFSETS) is False
    with pytest.raises(CommandError, match='READ_OFFSETS of IMU 2: the chip is absent'):
        board.read_offsets(2)


def test_bad_argument(connect):
    _, board, _ = connect()
    board.hello()
    with pytest.raises(CommandError, match='CONFIGURE: bad argument in 0f c8 0c 00'):
        board.configure(BoardConfiguration(MASK, 200, FusionMode.NDOF, 0))


def test_another_version_is_named(connect):
    _, board, _ = connect(version=7)
    told = r'speaks protocol version 7, this package version 2; .*make -C firmware upload'
    with pytest.raises(ProtocolVersionError, match=told):
        board.hello()


def test_a_mute_board(connect):
    virtual, board, _ = connect()
    virtual.mute()
    with pytest.raises(LinkError, match=r'no board answered HELLO within 0\.2 s; nothing came'):
        board.hello(patience_s=0.2)
    with pytest.raises(LinkError, match='no answer to STATS in 4 tries'):
        board.stats()


def test_a_wrong_baud_rate_is_guessed(connect):
    """What comes at another rate is garbage: every frame is damaged."""
    virtual, board, packets = connect()
    start(board, packets)
    virtual.corrupt_frames(10**9)
    with pytest.raises(LinkError, match='frames were damaged: is 500000 its baud rate'):
        board.hello(patience_s=0.3)


def test_a_device_that_says_something_else(connect, monkeypatch):
    virtual, board, _ = connect()
    monkeypatch.setattr(virtual._firmware, 'advance', lambda now_us: [b'G'])
    with pytest.raises(LinkError, match=r'no reply: is this package.*make -C firmware upload'):
        board.hello(patience_s=0.3)


def test_intact_frames_that_are_no_packets_are_counted(connect, monkeypatch):
    virtual, board, _ = connect()
    frames = [encode_frame(b'\x07nonsense'), encode_frame(b'\x8a\x02\x01\x00'), encode_frame(b'\xff')]
    monkeypatch.setattr(virtual._firmware, 'advance', lambda now_us: [frames.pop()] if frames else [])
    virtual.unmute()  # wakes it
    poll(board, lambda: board.malformed == 3)


def test_the_second_board_has_the_ids_from_9_on(make_board):
    virtual = make_board(arm=VirtualArm((2, 9, 11), ArmMotion(np.arange(1, 4) * 0.1)), number=1)
    port = SerialPort(virtual.path, 500_000)
    packets = []
    board = Board(port, lambda packet, _: packets.append(packet), number=1)
    assert board.hello().channels == 0b101
    board.write_offsets(11, OFFSETS)
    board.configure(BoardConfiguration(mask_of((9, 11)), 100, FusionMode.NDOF, 0))
    board.stream(Stream.QUATERNIONS)
    poll(board, lambda: packets and packets[-1].states == [State.RUN] * 2)
    assert packets[-1].sweep.ids == (9, 11)
    assert board.read_offsets(11) == OFFSETS
    assert board.read_offsets(9) != OFFSETS
    with pytest.raises(CommandError, match='READ_OFFSETS of IMU 10: the chip is absent'):
        board.read_offsets(10)
    with pytest.raises(CommandError, match='IMU 2 is on board 0, and this is board 1'):
        board.write_offsets(2, OFFSETS)
    port.close()


def test_cable_pulled_while_a_command_waits(connect):
    virtual, board, _ = connect()
    board.hello()
    virtual.unplug_cable()
    with pytest.raises(LinkError, match='was lost'):
        board.stats()
