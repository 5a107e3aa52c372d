"""Replay a recording with other models and compare them with the truth, from Python and without ROS.

sesa2 twin --config prototype3_8 --out trial --seconds 60     # or a recording of one's own
python examples/replay_and_evaluate.py trial estimate
"""

import sys

import sesa2


def main(trial, out):
    """Print the error of each model at each marker."""
    configuration = sesa2.load_configuration('prototype3_8')
    summary = sesa2.replay(trial, configuration, out, models=['pcc', 'spline'])
    print(f'{summary.sweeps} sweeps of {summary.duration:.1f} s')
    for warning in summary.warnings:
        print('warning:', warning)
    evaluation = sesa2.evaluate(out, trial, register='rigid')
    for warning in evaluation.warnings:
        print('warning:', warning)
    for model, markers in evaluation.models.items():
        for marker, error in markers.items():
            print(
                f'{model} {marker}: median {error.median_mm:.1f} mm, {error.median_pct:.2f} % of arc length'
            )


if __name__ == '__main__':
    try:
        main(*sys.argv[1:])
    except sesa2.Sesa2Error as error:
        sys.exit(f'error: {error}')
