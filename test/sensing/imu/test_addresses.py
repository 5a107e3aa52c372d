import pytest

from sesa2.sensing.imu.addresses import address_of, ids_by_board, ids_of, imu_id_at, mask_of


@pytest.mark.parametrize(
    ('imu_id', 'board', 'channel'), [(1, 0, 0), (8, 0, 7), (9, 1, 0), (16, 1, 7), (17, 2, 0)]
)
def test_an_id_is_eight_a_board_then_its_channel(imu_id, board, channel):
    assert address_of(imu_id) == (board, channel)
    assert imu_id_at(board, channel) == imu_id


def test_ids_of_each_board():
    assert ids_by_board((16, 2, 9, 1)) == {0: (1, 2), 1: (9, 16)}
    assert ids_by_board((17,)) == {2: (17,)}


def test_masks_say_channels_of_one_board():
    assert ids_of(0b1000_0110) == (2, 3, 8)
    assert ids_of(0b1000_0110, board=1) == (10, 11, 16)
    assert all(mask_of(ids_of(mask, board)) == mask for mask in range(256) for board in (0, 1, 2))
