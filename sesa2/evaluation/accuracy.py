"""How far estimated markers are from the true ones (thesis 4.5.1)."""

from dataclasses import dataclass

import numpy as np

from sesa2.shape.rotations import FloatArray


@dataclass(frozen=True, eq=False)
class MarkerError:
    """Errors of one model at one marker: distances between estimated and true positions.

    The thesis calls them absolute errors e; divided by the marker's arc length they are its relative errors E.
    All figures are NaN where nothing was scored.

    Attributes
    ----------
    times : (n,)
        truth times, s.
    distances : (n,)
        m.
    arc_length
        of the marker, m.
    """

    times: FloatArray
    distances: FloatArray
    arc_length: float

    @property
    def n(self) -> int:
        """Samples scored."""
        return len(self.distances)

    @property
    def median_mm(self) -> float:
        """Median error, mm."""
        return self._quantile_mm(0.5)

    @property
    def q3_mm(self) -> float:
        """Third quartile of the error, mm."""
        return self._quantile_mm(0.75)

    @property
    def rmse_mm(self) -> float:
        """Root of the mean squared error, mm."""
        return 1e3 * float(np.sqrt(np.mean(self.distances**2))) if self.n else float('nan')

    @property
    def median_pct(self) -> float:
        """Median error, % of the marker's arc length."""
        return self.median_mm * self._pct_per_mm

    @property
    def q3_pct(self) -> float:
        """Third quartile of the error, % of the marker's arc length."""
        return self.q3_mm * self._pct_per_mm

    @property
    def rmse_pct(self) -> float:
        """Root of the mean squared error, % of the marker's arc length."""
        return self.rmse_mm * self._pct_per_mm

    @property
    def _pct_per_mm(self) -> float:
        return 0.1 / self.arc_length

    def _quantile_mm(self, q: float) -> float:
        return 1e3 * float(np.quantile(self.distances, q)) if self.n else float('nan')


def marker_error(
    times: FloatArray, estimate: FloatArray, truth: FloatArray, arc_length: float
) -> MarkerError:
    """Errors at one marker, over the samples in which both positions are known.

    Parameters
    ----------
    times : (n,)
        truth times, s.
    estimate, truth : (n, 3)
        m, in the same frame; NaN where not known.
    arc_length
        of the marker, m.
    """
    distances = np.linalg.norm(estimate - truth, axis=1)
    known = ~np.isnan(distances)
    return MarkerError(times[known], distances[known], arc_length)
