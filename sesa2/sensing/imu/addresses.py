"""Where an IMU hangs: from its id to a board and a channel of the board's multiplexer, and back; said here alone.

Boards are counted from 0 in the order of their ports, channels from 0 as on the wire; id = 8 · board + channel + 1.
"""

from collections.abc import Iterable
from functools import cache
from typing import NamedTuple

CHANNELS = 8
"""Of a board's multiplexer."""


class Address(NamedTuple):
    """Place of an IMU."""

    board: int
    channel: int


def address_of(imu_id: int) -> Address:
    """Where the IMU of an id hangs."""
    return Address(*divmod(imu_id - 1, CHANNELS))


def imu_id_at(board: int, channel: int) -> int:
    """Id of the IMU on a channel of a board."""
    return CHANNELS * board + channel + 1


def ids_by_board(imu_ids: Iterable[int]) -> dict[int, tuple[int, ...]]:
    """Ids of each board that has any, boards and ids ascending."""
    found: dict[int, tuple[int, ...]] = {}
    for imu_id in sorted(imu_ids):
        board = address_of(imu_id).board
        found[board] = (*found.get(board, ()), imu_id)
    return found


def mask_of(imu_ids: Iterable[int]) -> int:
    """Mask of the channels on which IMUs of one board hang: bit k for channel k."""
    return sum(1 << address_of(imu_id).channel for imu_id in set(imu_ids))


@cache
def ids_of(mask: int, board: int = 0) -> tuple[int, ...]:
    """Ids of the IMUs in a mask of a board's channels, ascending."""
    return tuple(imu_id_at(board, channel) for channel in range(CHANNELS) if mask >> channel & 1)
