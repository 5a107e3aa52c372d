"""What the readings say."""

import time

from sesa2.configuration import files, validate
from sesa2.sensing.imu.bno055.scores import Scores
from sesa2.viewer.live import Diagnostic, Live
from sesa2.viewer.readings import calibration_html, complaints_html, rates_html, state_html

CONFIGURATION = validate({'arm': {'length': 0.3}, 'imus': {'ids': [2, 5], 'positions': [0.1, 0.3]}})


def live(**diagnostics):
    now = time.monotonic()
    said = {name.replace('__', ': '): Diagnostic(*d, now) for name, d in diagnostics.items()}
    return Live(configuration=CONFIGURATION, diagnostics=said)


def test_the_state_is_what_the_nodes_say():
    assert 'stopped' in state_html(live(), True)
    assert 'View only' in state_html(live(), False)
    running = live(
        estimator__sweeps=(0, '99.8 Hz', {}),
        serial_bridge__link=(
            0,
            'ok',
            {'lost_sweeps': '3', 'frame_errors_crc': '1', 'frame_errors_cobs': '4'},
        ),
        recorder__bag=(0, 'recording into x', {}),
    )
    running.latency_s = 0.0042
    text = state_html(running, True)
    for part in ('streaming, recording', '99.8 Hz', '4.2 ms late', '3 lost', '5 damaged'):
        assert part in text
    assert 'calibrating' in state_html(live(serial_bridge__link=(0, 'ok', {})), True)


def test_losses_of_several_boards_are_added_up():
    counts = {'lost_sweeps': '3', 'frame_errors_crc': '1'}
    several = live(**{f'serial_bridge__link {k}': (0, 'ok', counts) for k in (0, 1)})
    text = state_html(several, True)
    assert '6 lost' in text
    assert '2 damaged' in text


def test_what_was_said_long_ago_does_not_count():
    old = live(estimator__sweeps=(0, '99.8 Hz', {}))
    old.diagnostics = {name: d._replace(heard=d.heard - 60.0) for name, d in old.diagnostics.items()}
    assert not old.running
    assert 'stopped' in state_html(old, True)


def test_nodes_with_ever_new_names_fill_no_memory(monkeypatch):
    now = 100.0
    monkeypatch.setattr('sesa2.viewer.live.time.monotonic', lambda: now)
    some = live()
    for k in range(1000):
        now = 100.0 + k
        some.hear(
            {f'node_{k}: part': Diagnostic(0, 'ok', {}, now), 'estimator: a': Diagnostic(0, 'ok', {}, now)}
        )
    assert len(some.diagnostics) <= 5
    assert list(some.heard('estimator')) == ['a']
    now += 10.0
    some.hear({'player: bag': Diagnostic(0, 'playing', {}, now)})
    assert set(some.diagnostics) == {'player: bag'}


def test_complaints_are_shown_worst_first_and_as_text():
    text = complaints_html(
        live(
            estimator__imu_2=(1, 'nothing <b>measured</b>', {}),
            estimator__imu_5=(1, 'nothing <b>measured</b>', {}),
            serial_bridge__link=(2, 'no board', {}),
        )
    )
    assert text.index('no board') < text.index('nothing &lt;b&gt;measured')
    assert text.count('measured') == 1
    assert '2 parts, imu_2 to imu_5' in text


def test_a_system_that_could_not_start_says_why_and_one_that_stopped_is_just_stopped():
    assert 'no such port' in complaints_html(live(system__run=(2, 'no such port', {})))
    stopped = live(system__run=(1, 'stopped', {}))
    assert state_html(stopped, True).count('stopped') == 1
    assert complaints_html(stopped) == ''


def test_a_missing_imu_is_told_from_one_that_is_off():
    here = live(estimator__imu_2=(0, '99.8 Hz', {'rate_hz': '99.8'}))
    here.sensors[2] = CONFIGURATION.base
    text = rates_html(here)
    assert '99.8' in text
    assert text.count('measures') == 1
    assert text.count('missing') == 1


def test_magnetometers_have_a_table_and_their_sweeps_a_rate():
    said = {'rate_hz': '39.9'}
    here = live(
        estimator__fields=(0, '40.0 Hz', {}),
        estimator__magnetometer_1=(0, '39.9 Hz', said),
        estimator__magnetometer_2=(1, '', said | {'sweeps repeating': '9'}),
    )
    here.configuration = files.load(files.find('magnetic_1'))
    text = rates_html(here)
    assert 'IMU' not in text  # it has none
    assert [text.count(word) for word in ('measures', 'wrong', 'not used')] == [1, 1, 1]
    assert text.count('<td>1</td><td>0.11 m</td>') == 3
    assert '40.0 Hz' in state_html(here, True)


def test_bars_and_the_next_step():
    here = live()
    assert 'No IMU has told' in calibration_html(here)
    here.scores = {2: Scores(3, 3, 3, 3), 5: Scores(0, 3, 1, 0)}
    text = calibration_html(here)
    assert 'data-score="imu_5 accel 1"' in text
    assert 'calibrated' in text
    assert Scores(0, 3, 1, 0).next_step('NDOF') in text


def test_without_fusion_the_six_poses_are_shown():
    c = validate(
        {
            'arm': {'length': 0.3},
            'imus': {'ids': [2, 5], 'positions': [0.1, 0.3], 'fusion': '6d'},
            'serial': {'fusion': 'RAW'},
            'run': {'source': 'serial'},
        }
    )
    silent = live()
    silent.configuration = c
    assert 'in the mode calibrate' in calibration_html(silent)
    here = live(calibration__imu_2=(1, 'hold it still with each of these sides up: <-z>', {'poses': '5'}))
    here.configuration = c
    text = calibration_html(here)
    assert 'sides up: &lt;-z&gt;' in text
    assert 'data-poses="imu_2 5"' in text
    assert 'title="5 of 6"' in text
    assert 'nothing heard' in text
