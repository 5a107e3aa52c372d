"""What an alignment has found: the parameters say it, and `estimator/save` keeps it beside the file it came from."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from processes import node as program
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import Imu
from std_srvs.srv import Trigger

from sesa2.configuration import files, validate
from sesa2.messages.imu_messages import ImuMessages
from sesa2.nodes.estimator import EstimatorNode
from sesa2.ros.qos import STREAM
from sesa2.shape.rotations import from_rotation_vector, multiply

VALUES = {
    'run': {'source': 'external'},
    'arm': {'length': 0.3},
    'imus': {
        'ids': [2, 5],
        'positions': [0.1, 0.3],
        'mount_orientations': [0.6, 0.0, 0.0, 0.8],
        'topics': ['/drv/near', 'far/data'],
    },
    'models': ['pcc'],
    'sweep_timeout': 30.0,
}
NAMES = ['imus.mount_orientations', 'imus.headings']
T0 = 1_700_000_000_000_000_000


def aligned(graph, estimator, turn_deg=2.0):
    """Align with the second IMU tilted by so much."""
    prefix = estimator.get_namespace().rstrip('/')
    topics = {2: '/drv/near', 5: f'{prefix}/far/data'}
    tips = graph.listen(PoseStamped, f'{prefix}/pcc/tip', STREAM)
    imus = {i: graph.probe.create_publisher(Imu, topic, STREAM) for i, topic in topics.items()}
    graph.matched(*topics.values())
    tilted = multiply(from_rotation_vector([0.0, np.deg2rad(turn_deg), 0.0]), [0.6, 0.0, 0.0, 0.8])
    start = estimator.n_sweeps
    for k in range(start, start + 40):
        for i, q in ((2, [0.6, 0.0, 0.0, 0.8]), (5, tilted)):
            imus[i].publish(ImuMessages(f'imu_{i}').make(T0 + 10_000_000 * k + i, np.array(q)))
        graph.until(lambda n=k - start + 1: len(tips) == n, 'a result')
    answer = graph.call(Trigger, f'{prefix}/estimator/align', Trigger.Request())
    assert answer.success, answer.message


def parameters(graph, prefix=''):
    answer = graph.call(
        GetParameters, f'{prefix}/estimator/get_parameters', GetParameters.Request(names=NAMES)
    )
    return [list(value.double_array_value) for value in answer.values]


@pytest.fixture
def made(graph, configured, tmp_path):
    """An estimator whose configuration came from a file."""

    def make(origin=tmp_path / 'arm.yaml', **options):
        overrides = [
            *configured(VALUES),
            *([Parameter('configuration_file', value=str(origin))] if origin else []),
        ]
        return graph.add(EstimatorNode(parameter_overrides=overrides, **options))

    return make


@pytest.mark.parametrize('namespace', ['', 'left'])
def test_the_parameters_say_what_is_in_force_and_nobody_else_sets_them(graph, made, namespace):
    estimator = made(namespace=namespace)
    prefix = f'/{namespace}' if namespace else ''
    assert parameters(graph, prefix) == [[0.6, 0.0, 0.0, 0.8], [0.0]]
    wanted = [Parameter('imus.headings', value=[1.0]).to_parameter_msg()]
    answer = graph.call(
        SetParameters, f'{prefix}/estimator/set_parameters', SetParameters.Request(parameters=wanted)
    )
    assert not answer.results[0].successful
    assert 'read-only' in answer.results[0].reason
    aligned(graph, estimator)
    mountings, headings = parameters(graph, prefix)
    assert mountings == list(estimator.configuration.imus.mount_orientations)
    assert headings == list(estimator.configuration.imus.headings)
    assert len(mountings) == 8
    np.testing.assert_allclose(mountings[:4], [0.6, 0.0, 0.0, 0.8], atol=1e-6)
    assert not np.allclose(mountings[4:], [0.6, 0.0, 0.0, 0.8], atol=1e-3)
    answer = graph.call(
        SetParameters, f'{prefix}/estimator/set_parameters', SetParameters.Request(parameters=wanted)
    )
    assert not answer.results[0].successful
    assert parameters(graph, prefix)[1] == headings


def save(graph):
    return graph.call(Trigger, 'estimator/save', Trigger.Request())


def test_save_leaves_the_file_and_writes_beside_it(graph, made, tmp_path):
    (tmp_path / 'arm.yaml').write_text('# mine\n')
    estimator = made()
    aligned(graph, estimator)
    answer = save(graph)
    assert answer.success, answer.message
    out = tmp_path / 'arm_aligned.yaml'
    assert f'saved in {out}; {tmp_path}/arm.yaml stays as it is' in answer.message
    assert (tmp_path / 'arm.yaml').read_text() == '# mine\n'
    assert files.load(out) == estimator.configuration
    # What this node has saved it may save again; what somebody wrote since is kept.
    aligned(graph, estimator, -3.0)
    answer = save(graph)
    assert answer.success, answer.message
    assert 'in place of what was saved there before' in answer.message
    assert files.load(out) == estimator.configuration
    out.write_text('# by hand\n')
    answer = save(graph)
    assert not answer.success
    assert f'{out} is there already' in answer.message
    assert out.read_text() == '# by hand\n'
    assert sorted(p.name for p in tmp_path.iterdir()) == ['arm.yaml', 'arm_aligned.yaml']


def test_save_says_where_it_cannot(graph, made, tmp_path):
    made(origin=tmp_path / 'gone/arm.yaml')
    answer = save(graph)
    assert not answer.success
    assert 'arm_aligned.yaml: cannot be written: No such file' in answer.message


def test_save_says_that_it_knows_no_file(graph, made, tmp_path):
    made(origin=None)
    answer = save(graph)
    assert not answer.success
    assert 'not known which file' in answer.message
    assert '--params-file' in answer.message


def test_a_node_alone_knows_its_parameter_file(graph, tmp_path):
    path = tmp_path / 'arm.yaml'
    path.write_text(files.dump(validate(VALUES)))
    with program('estimator', tmp_path, '--ros-args', '--params-file', 'arm.yaml', '-r', '__ns:=/left'):
        answer = graph.call(Trigger, '/left/estimator/save', Trigger.Request())
    assert answer.success, answer.message
    assert files.load(tmp_path / 'arm_aligned.yaml') == files.load(path)


def test_a_shipped_configuration_is_saved_in_the_present_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert files.origin('prototype3_8') == tmp_path / 'prototype3_8.yaml'
    (tmp_path / 'arm.yaml').write_text(files.dump(validate(VALUES)))
    assert files.origin('arm.yaml') == tmp_path / 'arm.yaml'
