"""Truths as other systems write them: the same motion in each, so the same figures (`cases`, where they are)."""

import json

import pytest

from sesa2.cli import main
from sesa2.errors import Sesa2Error
from sesa2.evaluation.bag_evaluation import evaluate_bag

RIGHT = {'M1': 18.4, 'M2': 18.9}  # mm, median


def evaluated(cases, truth, **options):
    return evaluate_bag(cases / '00-common/est10', cases / truth, **({'register': 'rigid'} | options))


def check(evaluation, tolerance=0.06):
    medians = {name: error.median_mm for name, error in evaluation.models['pcc'].items()}
    assert medians == pytest.approx(RIGHT, abs=tolerance)


@pytest.mark.parametrize(
    'truth',
    [
        '08-motive-csv/same_as_ours.csv',
        '08-motive-csv/take.csv',
        '09-vicon-csv/trial.csv',
        '10-qualisys-tsv-trc-c3d/qtm.tsv',
        '10-qualisys-tsv-trc-c3d/arm.trc',
        '11-truth-in-a-bag/posestamped',
    ],
)
def test_an_export_is_read_as_it_is(cases, truth):
    evaluation = evaluated(cases, truth)
    check(evaluation)
    assert evaluation.warnings == ()


def test_an_array_with_the_base_in_it(cases):
    evaluation = evaluated(cases, '11-truth-in-a-bag/posearray3')
    check(evaluation)
    [warning] = evaluation.warnings
    assert '/poses[0] stands still: taken for the base' in warning


@pytest.mark.parametrize(
    ('truth', 'unit'), [('truth_ms.csv', 'milliseconds'), ('truth_ns.csv', 'nanoseconds')]
)
def test_the_unit_of_time_is_found_and_told(cases, truth, unit):
    evaluation = evaluated(cases, f'03-csv-time-unit/{truth}')
    check(evaluation, 0.5)  # nanoseconds since 1970 are rounded, which moves one sample between the halves
    assert unit in evaluation.warnings[0]


def test_frames_are_asked_about_and_read_with_their_rate(cases):
    with pytest.raises(Sesa2Error, match='time_s steps by 4, always: frames'):
        evaluated(cases, '03-csv-time-unit/truth_frames.csv')
    check(evaluated(cases, '03-csv-time-unit/truth_frames.csv', truth_rate=100.0))


def test_a_mirror_image_is_named_and_scored_mirrored_where_a_rotation_is_fitted(cases):
    mirrored = evaluated(cases, '12-truth-mirrored/y_z_swapped.csv')
    check(mirrored)
    assert 'The truth is a mirror image of the estimate (correlation 0.99' in mirrored.warnings[0]
    assert '0.944 as it is' in mirrored.warnings[0]
    for options in ({'register': 'none'}, {'register': 'translation', 'time_offset': -1700000000.0182}):
        with pytest.raises(Sesa2Error, match=r'mirror image .* --register rigid scores it mirrored'):
            evaluated(cases, '12-truth-mirrored/y_z_swapped.csv', **options)
    check(evaluated(cases, '12-truth-mirrored/y_z_swapped.csv', time_offset=-1700000000.0182))


def test_zeros_are_a_marker_that_was_not_seen(cases):
    evaluation = evaluated(cases, '15-lost-marker-is-zero/zeros.csv')
    check(evaluation, 0.6)
    assert evaluation.warnings[0] == 'M1: 0, 0, 0 stands 29 % of the time: taken as not seen.'


@pytest.mark.parametrize(
    'source',
    [
        '08-motive-csv/rigid_bodies.csv',
        '03-csv-time-unit/ms.csv',
        '03-csv-time-unit/ns.csv',
        '04-csv-negative-time/trigger.csv',
    ],
)
def test_orientations_are_replayed_as_those_of_imus(cases, source, tmp_path, capsys):
    arguments = ['--config', 'prototype3_4', '--models', 'pcc', '--out', str(tmp_path / 'out')]
    assert main(['replay', str(cases / source), *arguments]) == 0
    printed = capsys.readouterr()
    assert ': 60 sweeps of 0.6 s' in printed.out
    assert 'lack an IMU' not in printed.err


def test_the_command_takes_names_that_differ(cases, tmp_path, capsys):
    take = (cases / '08-motive-csv/take.csv').read_text(encoding='utf-8-sig')
    (tmp_path / 'take.csv').write_text(take.replace('Arm:M1', 'Arm:low').replace('Arm:M2', 'Arm:tip'))
    arguments = [
        'evaluate',
        str(cases / '00-common/est10'),
        '--truth',
        str(tmp_path / 'take.csv'),
        '--register',
        'rigid',
    ]
    assert main([*arguments, '--marker', 'M1=low', '--marker', 'M2=Arm:tip', '--json']) == 0
    figures = json.loads(capsys.readouterr().out)['models']['pcc']
    assert {name: figures[name]['median_mm'] for name in RIGHT} == pytest.approx(RIGHT, abs=0.06)
    assert main(arguments) == 1
    assert 'none of M1, M2 is in it; there are Arm:low, Arm:tip' in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([*arguments, '--marker', 'M1'])
    assert "got 'M1', expected MARKER=NAME" in capsys.readouterr().err


def test_axes_of_motive_are_told_where_no_rotation_is_fitted(cases):
    evaluation = evaluated(cases, '08-motive-csv/take.csv', register='translation')
    assert "take.csv: Motive's y axis points up, unless it was exported otherwise" in evaluation.warnings[0]
