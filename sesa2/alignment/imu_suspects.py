"""Which IMU of a recording is not what the configuration says: loose, elsewhere, or on a base that tilts.

What smooth shapes and constant corrections (mounting, heading) leave of the measured orientations is asked what would
explain it best: an IMU whose mounting changes at some time, an IMU at another place (it is off by so much times the
arm's curvature there), a base that tilts, which takes all IMUs along, or mountings that all lean the same way, as an
alignment on a leaning arm leaves them. As in `self_calibration` the shape is
marginalised, and so are the corrections and a heading that wanders.
"""

from typing import NamedTuple

import numpy as np

from sesa2.alignment.shape_prior import INDEPENDENCE_TIME, TWIST, ShapePrior, likelier_twist
from sesa2.sensing.imu.mounting import Mounting
from sesa2.shape.layout import Layout
from sesa2.shape.missing import fill_missing
from sesa2.shape.rotations import FloatArray, from_rotation_vector, rotate

MAX_FRAMES = 160
WINDOWS = 8  # of the recording; a change is looked for between them
MIN_SECONDS = 10.0

# Of what is not suspected: constant corrections, and a heading that wanders from window to window, rad.
MOUNTING_STD = np.deg2rad(4.0)
HEADING_STD = np.deg2rad(8.0)
WANDER_STD = np.deg2rad(3.0)
_ITERATIONS = 6


class Suspect(NamedTuple):
    """What would explain the orientations better.

    Attributes
    ----------
    kind
        'loose', 'place', 'base' or 'lean'.
    imu
        its index along the arm; −1 for the base and for all IMUs.
    size
        how far: rad of turning for 'loose', 'base' and 'lean', m for 'place' (positive: farther from the base than
        configured).
    after
        share of the recording after which it turned, 0 to 1; 0 for 'place' and 'lean'.
    evidence
        by how much twice the log-likelihood would rise.
    rest
        by how much it would rise further by the best of all others; known of the best of each kind, else infinite.
    """

    kind: str
    imu: int
    size: float
    after: float
    evidence: float
    rest: float = np.inf


class Examination(NamedTuple):
    """What a recording tells about its IMUs.

    Attributes
    ----------
    misfit
        squared disagreement of the typical frame with every smooth shape, per measured value and its assumed variance.
    suspects
        all that was asked, the best explanation first.
    """

    misfit: float
    suspects: list[Suspect]


def examine(
    stamps: FloatArray,
    orientations: FloatArray,
    measured: np.ndarray,
    layout: Layout,
    base: FloatArray,
    mountings: FloatArray,
    headings: FloatArray,
) -> Examination | None:
    """Look for an IMU that is not what the configuration says.

    Parameters
    ----------
    stamps : (n,)
        s.
    orientations : (n, n_imu, 4)
        q_WS as measured, x y z w, unit norm.
    measured : (n, n_imu)
        true where the IMU has measured.
    layout
        the arm and its IMUs.
    base : (4,) or (n, 4)
        q_WB, x y z w.
    mountings : (n_imu, 4)
        q_LS, x y z w.
    headings : (n_imu,)
        rad.

    Returns
    -------
    What was found; None for a recording that is too short to tell.
    """
    some = np.flatnonzero(measured.any(axis=1))
    if not len(some) or np.ptp(stamps[some]) < MIN_SECONDS:
        return None
    chosen = some[np.unique(np.linspace(0, len(some) - 1, MAX_FRAMES).astype(int))]
    t, there = stamps[chosen], measured[chosen]
    bases = np.broadcast_to(base, (len(stamps), 4))[chosen]
    q = np.where(there[..., None], orientations[chosen], (0.0, 0.0, 0.0, 1.0))
    links = fill_missing(Mounting(mountings, headings).link_orientations(q), there, layout, bases)
    window = np.minimum((WINDOWS * (t - t[0]) / (t[-1] - t[0])).astype(int), WINDOWS - 1)
    weight = min(1.0, float(np.ptp(t)) / INDEPENDENCE_TIME / len(t))
    return _Examiner(layout, links, there, bases, window, weight).examine()


class _Examiner:
    """Columns of the design: per IMU μx μy μz ψ, then the base's tilt about the world's x and y, then the places."""

    def __init__(
        self,
        layout: Layout,
        links: FloatArray,
        measured: np.ndarray,
        bases: FloatArray,
        window: np.ndarray,
        weight: float,
    ):
        self._prior = ShapePrior(layout)
        self._layout = layout
        self._links, self._measured, self._bases = links, measured, bases
        self._window, self._weight = window, weight
        self._rows = 3 * measured.sum(axis=1)
        n = links.shape[1]
        self._n = n
        self._headings = 4 * np.arange(n) + 3
        self._constant = np.arange(4 * n)
        variances = np.tile(np.square([MOUNTING_STD] * 3 + [HEADING_STD]), n)
        self._information = np.diag(1.0 / variances)

    def examine(self) -> Examination:
        beta = np.zeros(4 * self._n)
        twist, misfit = TWIST, np.inf
        curvature = self._prior.first_guess(self._links, self._bases)
        for iteration in range(_ITERATIONS):
            per_imu = beta.reshape(-1, 4)
            unturn = Mounting(from_rotation_vector(per_imu[:, :3]), per_imu[:, 3])
            corrected = unturn.link_orientations(self._links)
            self._prior.widen(corrected, self._bases)
            y, J, shape = self._prior.linearise(curvature, corrected, self._bases)
            marginal = self._prior.marginalise(J, self._measured, twist)
            D = self._design(shape, curvature)
            WD = marginal.precision @ D
            Wy = np.einsum('nrs,ns->nr', marginal.precision, y)
            off = np.einsum('nr,nr->n', y, Wy) / self._rows
            misfit = float(np.median(off))
            trust = self._weight / np.maximum(off, 1.0)
            N, b = self._by_window(D, WD, y, trust)
            c = self._constant
            N_all, b_all = N.sum(axis=0)[np.ix_(c, c)], b.sum(axis=0)[c]
            step = np.linalg.solve(N_all + self._information, b_all - self._information @ beta)
            beta = beta + step
            weighed = Wy - WD[..., c] @ step
            curvature = self._prior.most_likely(J, weighed, twist)
            if iteration > 0:
                twist = likelier_twist(twist, marginal, np.sqrt(trust / self._weight)[:, None] * weighed)
        # The last step is in `beta` but not in b.
        b = b - N[:, :, c] @ step
        return Examination(misfit, self._suspects(N, b, beta))

    def _design(self, shape: FloatArray, curvature: FloatArray) -> FloatArray:
        f, n = shape.shape[:2]
        D = np.zeros((f, n, 3, 5 * n + 2))
        axes = rotate(shape[:, :, None], np.eye(3)).swapaxes(-1, -2)  # link axes in columns
        bent = self._prior.curvature_at_imus(curvature) / self._layout.arm.length
        for i in range(n):
            D[:, i, :, 4 * i : 4 * i + 3] = axes[:, i]
            D[:, i, 2, 4 * i + 3] = 1.0
            D[:, i, :, 4 * n + 2 + i] = rotate(shape[:, i], bent[:, i])
        D[:, :, 0, 4 * n] = D[:, :, 1, 4 * n + 1] = 1.0
        return D.reshape(f, 3 * n, -1)

    def _by_window(
        self, D: FloatArray, WD: FloatArray, y: FloatArray, trust: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Normal equations of each window, (WINDOWS, d, d) and (WINDOWS, d), its own headings eliminated."""
        scaled = trust[:, None, None] * WD
        N, b = [], []
        for w in range(WINDOWS):
            inside = self._window == w
            n = np.einsum('fri,frj->ij', D[inside], scaled[inside])
            r = np.einsum('fri,fr->i', scaled[inside], y[inside])
            h = self._headings
            gain = n[:, h] @ np.linalg.inv(n[np.ix_(h, h)] + np.eye(len(h)) / WANDER_STD**2)
            N.append(n - gain @ n[h])
            b.append(r - gain @ r[h])
        return np.array(N), np.array(b)

    def _suspects(self, N: FloatArray, b: FloatArray, beta: FloatArray) -> list[Suspect]:
        """All of them, the best explanation first; of the best of each kind, what it leaves to the others."""
        n = self._n
        columns = np.eye(5 * n + 2)
        asked = [_Asked('place', i, columns[:, [4 * n + 2 + i]], 0) for i in range(n - 1)]
        asked.append(_Asked('lean', -1, columns[:, : 4 * n].reshape(-1, n, 4).sum(axis=1)[:, :2], 0))
        for first in range(2, WINDOWS - 1):
            asked += [_Asked('loose', i, columns[:, 4 * i : 4 * i + 3], first) for i in range(n)]
            asked.append(_Asked('base', -1, columns[:, 4 * n : 4 * n + 2], first))
        # Of the windows from each on.
        since = np.cumsum(N[::-1], axis=0)[::-1], np.cumsum(b[::-1], axis=0)[::-1]
        found = {id(one): self._suspect(one, [], since, beta) for one in asked}
        asked.sort(key=lambda one: -found[id(one)].evidence)
        best = {one.kind: one for one in reversed(asked)}
        for one in best.values():
            rest = max(
                self._suspect(other, [one], since, beta).evidence
                for other in asked
                if (other.kind, other.imu) != (one.kind, one.imu)
            )
            found[id(one)] = found[id(one)]._replace(rest=rest)
        return [found[id(one)] for one in asked]

    def _suspect(
        self, asked: '_Asked', given: list['_Asked'], since: tuple[FloatArray, FloatArray], beta: FloatArray
    ) -> Suspect:
        """How well what is asked explains what constant corrections, and what is given, leave."""
        constant = _Asked('constant', -1, np.eye(5 * self._n + 2)[:, self._constant], 0)
        left = [constant, *given]
        both = [
            [x.columns.T @ since[0][max(x.first, y.first)] @ y.columns for y in (*left, asked)]
            for x in (*left, asked)
        ]
        both[0][0] = both[0][0] + self._information
        pull = [x.columns.T @ since[1][x.first] for x in (*left, asked)]
        pull[0] = pull[0] - self._information @ beta
        normal, gradient = np.block(both), np.concatenate(pull)
        k = len(gradient) - asked.columns.shape[1]
        gain = np.linalg.solve(normal[:k, :k] + 1e-9 * np.eye(k), normal[:k, k:]).T
        own = normal[k:, k:] - gain @ normal[:k, k:]
        unexplained = gradient[k:] - gain @ gradient[:k]
        found = np.linalg.lstsq(own + 1e-9 * np.eye(len(own)), unexplained, rcond=None)[0]
        size = float(found[0]) if asked.kind == 'place' else float(np.linalg.norm(found))
        return Suspect(asked.kind, asked.imu, size, asked.first / WINDOWS, float(found @ unexplained))


class _Asked(NamedTuple):
    """A suspect: what it does to the orientations, as columns of the design, and from which window on."""

    kind: str
    imu: int
    columns: FloatArray
    first: int
