"""The examples do what they say, run as a user runs them."""

import importlib.util
import math
import signal

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from made_bags import stamps_of, write_bag
from processes import REPOSITORY, Program, command

import sesa2
from sesa2.ros.qos import STREAM
from sesa2.shape.model import MODELS

EXAMPLES = REPOSITORY / 'examples'


@pytest.fixture
def own_model():
    before = dict(MODELS)
    spec = importlib.util.spec_from_file_location('own_model', EXAMPLES / 'own_model.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module
    MODELS.clear()
    MODELS.update(before)


def test_a_node_of_ones_own_reads_the_shape(graph, tmp_path):
    with (
        Program([EXAMPLES / 'read_the_shape.py'], tmp_path) as reader,
        command(tmp_path, 'run', '--config', 'prototype3_8', '--source', 'sim') as system,
    ):
        graph.until(lambda: 'tip at' in reader.errors + reader.output, 'the tip')
        reader.signal(signal.SIGINT)
        assert reader.ended() == 0
        assert 'Traceback' not in reader.errors
        system.signal(signal.SIGINT)
        assert system.ended() == 0


def test_a_driver_of_another_imu_is_heard(graph, tmp_path):
    with (
        Program([EXAMPLES / 'imu_driver.py', *range(1, 9)], tmp_path) as driver,
        command(tmp_path, 'run', '--config', 'prototype3_8', '--source', 'external') as system,
    ):
        tips = graph.listen(PoseStamped, 'pcc/tip', STREAM)
        graph.until(lambda: len(tips) > 50, 'fifty results')
        for program in (driver, system):
            program.signal(signal.SIGINT)
            assert program.ended() == 0
            assert 'Traceback' not in program.errors
    # It swings about x: the tip stays in the plane of y and z.
    for tip in tips:
        assert abs(tip.pose.position.x) < 1e-9
        assert tip.pose.position.z > 0.5


def test_replay_and_evaluate_from_python(tmp_path):
    with command(
        tmp_path, 'twin', '--config', 'prototype3_8', '--out', 'trial', '--seconds', 20, '--error', 'white=0'
    ) as twin:
        assert twin.ended() == 0
    with Program([EXAMPLES / 'replay_and_evaluate.py', 'trial', 'estimate'], tmp_path) as example:
        assert example.ended() == 0, example.errors
        lines = example.output.splitlines()
        assert 'sweeps of' in lines[0]
        assert [' '.join(line.split()[:2]) for line in lines if ': median' in line] == [
            'pcc M1:',
            'pcc M2:',
            'spline M1:',
            'spline M2:',
        ]
    with Program([EXAMPLES / 'replay_and_evaluate.py', 'nowhere', 'other'], tmp_path) as example:
        assert example.ended() == 1
        assert example.errors.startswith('error: nowhere: no such file')


def test_a_model_of_ones_own_is_a_model_like_ours(own_model, tmp_path):
    c = sesa2.load_configuration('prototype3_8')
    write_bag(tmp_path / 'recording', range(1, 9), stamps_of(1.0))
    summary = sesa2.replay(tmp_path / 'recording', c, tmp_path / 'out', models=['one_arc'])
    assert summary.messages['/one_arc/tip'] == summary.sweeps > 90
    # A quarter of a circle of length 0.64 m, about x.
    q = np.tile([0.0, 0.0, 0.0, 1.0], (8, 1))
    q[-1] = [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]
    [end] = c.create_model('one_arc').fit(sesa2.Measured(q)).positions([0.64])
    r = 0.64 / (0.5 * math.pi)
    np.testing.assert_allclose(end, [0.0, -r, r], atol=1e-12)
    own_model.main()
