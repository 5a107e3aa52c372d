"""Names on the ROS graph, relative, so that a namespace gives each arm its own."""

from sesa2.configuration import Configuration

CLOCK = '/clock'
COMMAND = 'command'
TARGET = 'target'
CONFIGURATION = 'configuration'
BACKBONE_LENGTHS = 'backbone_lengths'
DIAGNOSTICS = '/diagnostics'
TRUTH_COORDINATES = 'truth/coordinates'
TRUTH_MARKERS = 'truth/markers'
TRUTH_SHAPE = 'truth/shape'
TRUTH_TIP = 'truth/tip'


def absolute(name: str) -> str:
    """A topic's absolute name; some writers leave out the slash in front."""
    return '/' + name.lstrip('/')


def is_called(topic: str, name: str) -> bool:
    """Whether an absolute name is this one, or this one in whichever namespace where it is relative."""
    return topic == name or (not name.startswith('/') and topic.endswith(f'/{name}'))


def imu_name(imu_id: int) -> str:
    """An IMU's name: its part in diagnostics, and in the names of its topics and its frame."""
    return f'imu_{imu_id}'


def imu_data(imu_id: int) -> str:
    """Topic of what an IMU measures, sensor_msgs/Imu, where the configuration says nothing else."""
    return f'{imu_name(imu_id)}/data'


def imu_topics(c: Configuration) -> dict[int, str]:
    """Topic of each IMU's orientation by its id: as configured, else as `imu_data` says."""
    ids = c.imus.all_ids
    return dict(zip(ids, c.imus.topics or map(imu_data, ids), strict=True))


def imu_frame(c: Configuration, imu_id: int) -> str:
    """Frame of an IMU."""
    return c.frame(imu_name(imu_id))


def imu_field(imu_id: int) -> str:
    """Topic of the magnetic field beside an IMU, sensor_msgs/MagneticField, where the configuration names no topics."""
    return f'{imu_name(imu_id)}/mag'


def imu_fields(c: Configuration) -> dict[int, str]:
    """Topic of the magnetic field beside each IMU by its id: `mag` beside its own, as drivers have it.

    Where that would be one for several, as `imu_field` says.
    """
    beside = {i: '/'.join([*topic.split('/')[:-1], 'mag']) for i, topic in imu_topics(c).items()}
    return beside if len(set(beside.values())) == len(beside) else {i: imu_field(i) for i in beside}


def magnetometer_name(magnetometer_id: int) -> str:
    """A magnetometer's name: its part in diagnostics, and in the names of its topic and its frame."""
    return f'magnetometer_{magnetometer_id}'


def magnetometer_field(magnetometer_id: int) -> str:
    """Topic of what a magnetometer in or around the arm measures, sensor_msgs/MagneticField."""
    return f'{magnetometer_name(magnetometer_id)}/field'


def imu_calibration(imu_id: int) -> str:
    """Topic of an IMU's scores and offsets, sesa2_msgs/ImuCalibration."""
    return f'{imu_name(imu_id)}/calibration'


def of_model(model: str, kind: str) -> str:
    """Topic of a model's result; `kind` is joint_states, coordinates, markers, tip, shape, marker_array or
    robot_description.
    """
    return f'{model}/{kind}'
