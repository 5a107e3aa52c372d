"""Names on the ROS graph, relative, so that a namespace gives each arm its own."""

CONFIGURATION = 'configuration'
DIAGNOSTICS = '/diagnostics'
TRUTH_MARKERS = 'truth/markers'
TRUTH_SHAPE = 'truth/shape'


def absolute(name: str) -> str:
    """A topic's absolute name; some writers leave out the slash in front."""
    return '/' + name.lstrip('/')


def imu_name(imu_id: int) -> str:
    """An IMU's name: its frame, and its part in diagnostics."""
    return f'imu_{imu_id}'


def imu_data(imu_id: int) -> str:
    """Topic of what an IMU measures, sensor_msgs/Imu."""
    return f'{imu_name(imu_id)}/data'


def imu_field(imu_id: int) -> str:
    """Topic of the magnetic field beside an IMU without orientation, sensor_msgs/MagneticField."""
    return f'{imu_name(imu_id)}/mag'


def imu_calibration(imu_id: int) -> str:
    """Topic of an IMU's scores and offsets, sesa2_msgs/ImuCalibration."""
    return f'{imu_name(imu_id)}/calibration'


def of_model(model: str, kind: str) -> str:
    """Topic of a model's result; `kind` is joint_states, markers, tip, shape, marker_array or robot_description."""
    return f'{model}/{kind}'
