"""A real arm whose markers and base sit beside its axis (other people's recording, where it is)."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sesa2.evaluation.evaluate import evaluate
from sesa2.evaluation.trajectory import EvaluationError, Trajectory
from sesa2.shape.arm import Arm
from sesa2.shape.layout import Layout
from sesa2.shape.measured import Measured
from sesa2.shape.models import create_model

NAMES = ('low', 'middle', 'tip')
ENDS = np.cumsum([0.2116, 0.2103, 0.2092])


@pytest.fixture(scope='module')
def arm(recordings):
    """Estimate and truth, in order of time; rows that were mistracked are left out."""
    file = recordings / 'softarm/optitrack_first_1500_rows.csv'
    if not file.is_file():
        pytest.skip(f'no {file}')
    frames = np.genfromtxt(file, delimiter=',', skip_header=1)[:, 1:].reshape(-1, 4, 6)
    p = frames[..., :3]
    R = Rotation.from_euler('ZYX', frames[..., [5, 4, 3]].reshape(-1, 3), degrees=True)
    q = (R * Rotation.from_euler('x', -90.0, degrees=True)).as_quat().reshape(len(p), 4, 4)
    along = Rotation.from_quat(q.reshape(-1, 4)).apply((0.0, 0.0, 1.0)).reshape(len(p), 4, 3)
    chord = np.linalg.norm(p[:, 3] - p[:, 2], axis=1)
    bend = np.degrees(np.arccos(np.clip((along[:, 3] * along[:, 2]).sum(axis=1), -1.0, 1.0)))
    tracked = (chord >= 0.195) & (chord <= 0.212) & (bend <= 60.0)
    p, q = p[tracked], q[tracked]
    model = create_model('pcc_exact', Layout(Arm(float(ENDS[-1])), tuple(ENDS.tolist())))
    backbone = model.fit(Measured(q[:, 1:], q[:, 0]))
    times = np.arange(len(p), dtype=float)
    estimate = Trajectory(times, backbone.positions(ENDS) + p[:, :1], NAMES, backbone.orientations(ENDS))
    return estimate, Trajectory(times, p[:, 1:], NAMES)


def medians(arm, register):
    estimate, truth = arm
    lengths = dict(zip(NAMES, ENDS, strict=True))
    found = evaluate({'pcc_exact': estimate}, truth, lengths, register=register, time_offset=0.0)
    return [error.median_pct for error in found.models['pcc_exact'].values()], found


def test_offsets_halve_what_a_translation_leaves(arm):
    translation, _ = medians(arm, 'translation')
    offsets, found = medians(arm, 'offsets')
    both, _ = medians(arm, 'rigid+offsets')
    assert translation == pytest.approx([4.9, 2.45, 1.8], abs=0.15)
    assert offsets == pytest.approx([1.92, 1.04, 1.12], abs=0.1)
    assert both == pytest.approx([1.24, 1.12, 1.14], abs=0.1)
    assert found.to_json()['registration']['offsets_m'] == found.registration.offsets.tolist()


def test_the_registration_that_helps_is_told(arm):
    _, found = medians(arm, 'none')
    assert any(
        'with --register translation the median error would be' in w or '+offsets' in w
        for w in found.warnings
    )


def test_offsets_are_refused_without_orientations(arm):
    estimate, truth = arm
    bare = Trajectory(estimate.times, estimate.positions, NAMES)
    with pytest.raises(EvaluationError, match='needs the orientations of the markers'):
        medians((bare, truth), 'offsets')
