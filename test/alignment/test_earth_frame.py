"""IMUs whose earth frame points down; the conversion to it is scipy's."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sesa2.alignment.earth_frame import UPSIDE_DOWN, BaseComparison
from sesa2.alignment.straight_pose import align_straight
from sesa2.bags.reading import read_poses
from sesa2.bags.replay import replay
from sesa2.cli import main
from sesa2.configuration import files
from sesa2.evaluation.bag_evaluation import evaluate_bag

# Components of east, north, up to those of north, east, down.
NED = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
IDS = (2, 4, 6)
UPRIGHT = Rotation.identity()
HANGING = Rotation.from_euler('x', 180, degrees=True)
LYING = Rotation.from_euler('xz', (90, 30), degrees=True)


def links(base, bend=2.5, n=200, seed=3):
    """Links of an arm that bends by up to so much, rad, along its length in any direction; (n, 3, 4), q_WL."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, 2 * np.pi, n)
    bends = bend * rng.uniform(0, 1, (n, 1)) * np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1)
    return np.stack([(base * Rotation.from_rotvec(bends * s)).as_quat() for s in (0.3, 0.6, 1.0)], axis=1)


def converted(q, rotation):
    return (rotation * Rotation.from_quat(q.reshape(-1, 4))).as_quat().reshape(q.shape)


def doubt(q, base, measured=None):
    comparison = BaseComparison()
    measured = np.ones(q.shape[:2], bool) if measured is None else measured
    for half in np.array_split(np.arange(len(q)), 2):
        comparison.add(q[half], measured[half], np.tile(base.as_quat(), (len(half), 1)))
    return comparison.doubt


def test_the_quaternion_that_is_told_is_that_of_the_conversion():
    told = Rotation.from_quat([0.7071, 0.7071, 0.0, 0.0])
    assert (told * NED.inv()).magnitude() < 1e-4
    assert '[0.7071, 0.7071, 0.0, 0.0]' in UPSIDE_DOWN


@pytest.mark.parametrize('bend', [0.0, 1.0, 2.5])
@pytest.mark.parametrize('turn', [0, 77, 200])
def test_an_earth_frame_that_points_down_is_seen_whatever_the_headings(bend, turn):
    q = links(UPRIGHT, bend)
    north = Rotation.from_euler('z', turn, degrees=True)
    assert doubt(converted(q, NED * north), UPRIGHT) == UPSIDE_DOWN
    assert doubt(converted(q, NED), NED) == ''  # as it is told to be mended


@pytest.mark.parametrize('base', [UPRIGHT, HANGING, LYING, NED])
@pytest.mark.parametrize('bend', [0.0, 1.0, 3.1])
def test_an_arm_as_it_is_configured_is_sound(base, bend):
    assert doubt(links(base, bend), base) == ''


def test_one_imu_the_wrong_way_round_is_none_of_the_frame():
    q = links(UPRIGHT, 0.3)
    q[:, 1] = converted(q[:, 1], NED)
    assert doubt(q, UPRIGHT) == ''
    q[:, 0] = converted(q[:, 0], NED)
    assert doubt(q, UPRIGHT) == ''


def test_imus_that_have_not_measured_say_nothing():
    q = converted(links(UPRIGHT, 0.3), NED)
    q[:, 0] = 0.0
    measured = np.ones(q.shape[:2], bool)
    measured[:, 0] = False
    assert doubt(q, UPRIGHT, measured) == UPSIDE_DOWN
    assert doubt(q, UPRIGHT, ~np.ones_like(measured)) == ''
    assert BaseComparison().doubt == ''


def test_a_straight_pose_names_it_alone():
    q = converted(links(UPRIGHT, 0.001), NED)
    still = np.tile([0.0, 0.0, 0.0, 1.0], (3, 1))
    arguments = (q, np.ones(q.shape[:2], bool), UPRIGHT.as_quat(), still, np.zeros(3))
    assert align_straight(*arguments, ids=IDS).doubts(IDS) == [UPSIDE_DOWN]


def test_the_case(cases, tmp_path, capsys):
    bag, truth = str(cases / '21-ned/bag'), cases / '08-motive-csv/same_as_ours.csv'
    right = replay(bag, files.load(cases / '21-ned/ned.yaml'), tmp_path / 'right', models=['pcc'])
    assert right.warnings == []
    errors = evaluate_bag(tmp_path / 'right', truth).to_json()['models']['pcc']
    assert errors['M1']['median_mm'] == pytest.approx(23.5, abs=0.5)
    assert errors['M2']['median_mm'] == pytest.approx(22.9, abs=0.5)
    wrong = replay(bag, files.load(files.find('prototype3_4')), tmp_path / 'wrong', models=['pcc'])
    assert wrong.warnings == [UPSIDE_DOWN]
    out = str(tmp_path / 'aligned.yaml')
    arguments = ['align', bag, '--duration', '1', '--config', 'prototype3_4', '--out', out]
    assert main(arguments) == 0
    assert capsys.readouterr().err == f'warning: {UPSIDE_DOWN}\n'
    arguments = ['align', bag, '--self', '--config', 'prototype3_4', '--out', str(tmp_path / 'self.yaml')]
    assert main(arguments) == 0
    assert f'warning: {UPSIDE_DOWN}\n' in capsys.readouterr().err
    assert len(read_poses(tmp_path / 'wrong', 'pcc/markers').times_s) == 1190
