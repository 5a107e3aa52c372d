import numpy as np

from sesa2.evaluation.accuracy import MarkerError
from sesa2.evaluation.plots import _tube, _with_breaks


def test_the_tube_keeps_its_radius_across_the_curve():
    t = np.linspace(0.0, 3.0, 200)
    helix = np.stack((0.1 * np.cos(t), 0.1 * np.sin(t), 0.05 * t), axis=1)
    radii = np.linspace(0.0, 0.03, 200)
    rings = _tube(helix, radii)
    spokes = rings - helix[:, None]
    np.testing.assert_allclose(np.linalg.norm(spokes, axis=2), np.tile(radii[:, None], 40), atol=1e-12)
    tangents = np.stack((-0.1 * np.sin(t), 0.1 * np.cos(t), np.full(200, 0.05)), axis=1)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    across = np.einsum('kaj,kj->ka', spokes, tangents) / np.maximum(radii, 1e-9)[:, None]
    assert np.abs(across[1:-1]).max() < 1e-3
    # neighbouring rings are not turned against each other
    steps = np.linalg.norm(np.diff(spokes[1:-1] / radii[1:-1, None, None], axis=0), axis=2)
    assert steps.max() < 0.02


def test_lines_are_broken_in_gaps():
    times = np.array([0.0, 0.1, 0.2, 1.0, 1.1])
    t, d = _with_breaks(MarkerError(times, np.arange(5.0), 0.5))
    np.testing.assert_array_equal(np.isnan(d), [False, False, False, True, False, False])
    np.testing.assert_array_equal(d[~np.isnan(d)], np.arange(5.0))
    assert len(t) == 6
