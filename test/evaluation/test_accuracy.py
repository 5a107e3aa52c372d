import numpy as np
import pytest

from sesa2.evaluation.accuracy import marker_error


def test_figures_of_known_errors():
    t = np.arange(5.0)
    truth = np.zeros((5, 3))
    estimate = np.array([[3e-3, 4e-3, 0], [0, 0, 1e-3], [0, 2e-3, 0], [np.nan] * 3, [0, 0, 0.01]])
    error = marker_error(t, estimate, truth, 0.5)
    np.testing.assert_array_equal(error.times, [0, 1, 2, 4])
    assert error.n == 4
    assert error.median_mm == pytest.approx(3.5)
    assert error.q3_mm == pytest.approx(6.25)
    assert error.rmse_mm == pytest.approx(np.sqrt((25 + 1 + 4 + 100) / 4))
    assert error.median_pct == pytest.approx(0.7)
    assert error.q3_pct == pytest.approx(1.25)
    assert error.rmse_pct == pytest.approx(error.rmse_mm / 5)


def test_nothing_scored():
    error = marker_error(np.arange(2.0), np.full((2, 3), np.nan), np.zeros((2, 3)), 0.5)
    assert error.n == 0
    assert np.isnan([error.median_mm, error.q3_mm, error.rmse_mm, error.median_pct]).all()
