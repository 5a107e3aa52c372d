from pathlib import Path

from rosbags.typesys import get_types_from_msg

from sesa2.bags.definitions import IMU_CALIBRATION, definition, typestore

ROOT = Path(__file__).resolve().parents[2]


def test_our_own_message_is_the_one_of_the_interface_package():
    text = (ROOT / 'msg_defs/msg/ImuCalibration.msg').read_text()
    name = 'sesa2_msgs/msg/ImuCalibration'
    assert get_types_from_msg(text, name) == get_types_from_msg(IMU_CALIBRATION, name)


def test_a_definition_holds_the_types_inside_it():
    text, type_hash = definition('sesa2_msgs/msg/ImuCalibration')
    for expected in ('int16 mag_radius', 'MSG: std_msgs/Header', 'MSG: builtin_interfaces/Time'):
        assert expected in text
    assert type_hash.startswith('RIHS01_')


def test_the_hash_is_the_one_that_ros_2_knows():
    # As in every Jazzy installation, share/std_msgs/msg/String.json.
    assert typestore().hash_rihs01('std_msgs/msg/String') == (
        'RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18'
    )
