"""The report's figures, as PNG: figures 5.2 to 5.4 of the thesis for any trial, and the error over time."""

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from sesa2.evaluation.accuracy import MarkerError
from sesa2.evaluation.drawn_pose import DrawnPose
from sesa2.evaluation.trajectory import LONGEST_STEP, EvaluationError
from sesa2.shape.rotations import FloatArray, rotate, swing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MARKER_COLOURS = (
    '#4477aa',
    '#e07b9a',
    '#55a868',
    '#c9962c',
    '#8172b2',
    '#64b5cd',
)  # the first two as in the thesis
SERIES_COLOURS = ('#1b6ca8', '#d1603d', '#3f8f5b', '#8e5aa8', '#b8902a', '#5b7083', '#b8456b', '#2a9d9d')
STYLE: Any = {
    'font.size': 9.0,
    'axes.spines.top': False,
    'axes.spines.right': False,
    'axes.grid': True,
    'axes.axisbelow': True,
    'grid.color': '#e3e6ea',
    'axes.edgecolor': '#8a929b',
    'legend.frameon': False,
    'savefig.dpi': 160.0,
}


@dataclass(frozen=True, eq=False)
class Series:
    """The errors of one model in one trial, as one line or group of boxes.

    Attributes
    ----------
    name
        what the reader sees.
    panel
        which plot it belongs to, for the box plots.
    errors
        by marker.
    number
        its colour and its place beside the others, the same in all figures.
    fitted_on
        truth times that were fitted and not scored, s.
    backbone
        a pose to draw the error around.
    """

    name: str
    panel: str
    errors: dict[str, MarkerError]
    number: int = 0
    fitted_on: tuple[float, float] | None = None
    backbone: DrawnPose | None = None


def require_matplotlib() -> None:
    """Say what to install where matplotlib is absent.

    Raises
    ------
    EvaluationError
        it is.
    """
    try:
        import matplotlib  # noqa: F401
    except ImportError as e:
        raise EvaluationError(
            "a report needs matplotlib, which is not installed: pip install 'sesa2[report]', "
            'or apt install python3-matplotlib'
        ) from e


def _png(draw: Callable[[Sequence[Series]], 'Figure']) -> Callable[[Sequence[Series]], bytes]:
    """Draw in the report's style, which is nobody else's, and encode."""

    @wraps(draw)
    def drawn(series: Sequence[Series]) -> bytes:
        import matplotlib as mpl

        with mpl.rc_context(STYLE):
            file = io.BytesIO()
            draw(series).savefig(file, format='png')
        return file.getvalue()

    return drawn


@_png
def box_plots(series: Sequence[Series]) -> 'Figure':
    """Errors by series and marker, in mm and in % of arc length: thesis figures 5.3 and 5.4.

    Boxes hold the middle half with the median across; whiskers reach from the 5th to the 95th percentile.
    """
    panels = list(dict.fromkeys(s.panel for s in series))
    most = max(sum(s.panel == panel for s in series) for panel in panels)
    figure = _figure(min(11.0, max(7.0, 2.0 + 1.6 * most)), 0.5 + 2.7 * len(panels))
    axes = figure.subplots(len(panels), 2, squeeze=False)
    for row, panel in zip(axes, panels, strict=True):
        shown = [s for s in series if s.panel == panel]
        for ax, per_metre, unit in ((row[0], _mm, 'error (mm)'), (row[1], _pct, 'error (% of arc length)')):
            markers = list(dict.fromkeys(name for s in shown for name in s.errors))
            width = 0.7 / len(markers)
            for m, name in enumerate(markers):
                colour = MARKER_COLOURS[m % len(MARKER_COLOURS)]
                at = [i + (m - 0.5 * (len(markers) - 1)) * width for i in range(len(shown))]
                ax.boxplot(
                    [per_metre(s.errors[name]) if name in s.errors else [] for s in shown],
                    positions=at,
                    widths=0.85 * width,
                    whis=(5, 95),
                    showfliers=False,
                    patch_artist=True,
                    boxprops={'facecolor': colour, 'edgecolor': '#333333', 'alpha': 0.75},
                    medianprops={'color': 'black', 'linewidth': 1.5},
                    whiskerprops={'color': '#555555'},
                    capprops={'color': '#555555'},
                    manage_ticks=False,
                )
                ax.plot([], [], 's', color=colour, alpha=0.75, label=name)
            ax.set_xticks(range(len(shown)), [s.name for s in shown])
            if len(shown) > 3 or max(len(s.name) for s in shown) > 12:
                ax.tick_params('x', labelrotation=20)
            ax.set_xlim(-0.6, len(shown) - 0.4)
            ax.set_ylim(bottom=0.0)
            ax.grid(visible=False, axis='x')
            ax.set_ylabel(unit)
            ax.set_title(panel, loc='left', fontweight='bold', fontsize=9.0)
    axes[0, 1].legend(loc='upper left', bbox_to_anchor=(1.0, 1.0))
    return figure


@_png
def error_along_the_arm(series: Sequence[Series]) -> 'Figure':
    """Median error over the markers' arc lengths, with the middle half of the errors as a bar."""
    figure = _figure(9.0, 3.4)
    axes = figure.subplots(1, 2)
    for ax, per_metre, unit in ((axes[0], _mm, 'error (mm)'), (axes[1], _pct, 'error (% of arc length)')):
        for s in series:
            scored = sorted((e for e in s.errors.values() if e.n), key=lambda e: e.arc_length)
            if not scored:
                continue
            q1, median, q3 = np.array([np.quantile(per_metre(e), (0.25, 0.5, 0.75)) for e in scored]).T
            # side by side, so that the bars of several series at one marker can be told apart
            at = np.array([1e3 * e.arc_length for e in scored]) + 5.0 * (s.number - 0.5 * (len(series) - 1))
            ax.errorbar(
                at,
                median,
                (median - q1, q3 - median),
                fmt='o',
                linestyle=_line(s.number),
                color=_colour(s.number),
                label=s.name,
                capsize=2.5,
            )
        ax.set_xlim(left=0.0)
        ax.set_ylim(bottom=0.0)
        ax.set_xlabel('arc length of the marker (mm)')
        ax.set_ylabel(unit)
    axes[1].legend(loc='upper left', bbox_to_anchor=(1.0, 1.0))
    return figure


@_png
def error_over_time(series: Sequence[Series]) -> 'Figure':
    """Error at each marker over the trial; the part that a registration was fitted on is shaded."""
    markers = list(dict.fromkeys(name for s in series for name in s.errors))
    figure = _figure(10.0, 0.6 + 2.1 * len(markers))
    axes = figure.subplots(len(markers), 1, sharex=True, squeeze=False)[:, 0]
    fitted = sorted(
        {tuple(np.subtract(s.fitted_on, _start(s)).tolist()) for s in series if s.fitted_on is not None}
    )
    for ax, name in zip(axes, markers, strict=True):
        for k, (first, last) in enumerate(fitted):
            ax.axvspan(first, last, color='#eef1f4', label='fitted, not scored' if k == 0 else None)
        for s in series:
            if name not in s.errors or not s.errors[name].n:
                continue
            times, distances = _with_breaks(s.errors[name])
            ax.plot(
                times - _start(s),
                1e3 * distances,
                color=_colour(s.number),
                linestyle=_line(s.number),
                linewidth=0.7,
                label=s.name,
            )
        ax.set_ylim(bottom=0.0)
        ax.set_ylabel(f'error at {name} (mm)')
        ax.margins(x=0.01)
    axes[-1].set_xlabel('time since the start (s)')
    legend = axes[0].legend(loc='upper left', bbox_to_anchor=(1.0, 1.0))
    for line in legend.get_lines():
        line.set_linewidth(2.0)
    return figure


@_png
def hulls(series: Sequence[Series]) -> 'Figure':
    """The third quartile of the error as a tube around a pose, up to the last marker: thesis figure 5.2.

    The radius grows linearly from nothing at the base to Q3 at each marker; three quarters of the estimates lie inside
    at the markers, and between them the tube is an interpolation.
    """
    columns = min(3, len(series))
    rows = -(-len(series) // columns)
    figure = _figure(3.6 * columns + 0.4, 3.7 * rows)
    for i, s in enumerate(series):
        assert s.backbone is not None
        ax: Any = figure.add_subplot(rows, columns, i + 1, projection='3d')
        scored = sorted((e for e in s.errors.values() if e.n), key=lambda e: e.arc_length)
        knots = np.array([0.0, *(e.arc_length for e in scored)])
        radii = np.array([0.0, *(1e-3 * e.q3_mm for e in scored)])
        along = np.linspace(0.0, min(knots[-1], s.backbone.arc_lengths[-1]), 90)
        surface = _tube(s.backbone.at(along), np.interp(along, knots, radii))
        ax.plot_surface(
            *np.moveaxis(surface, -1, 0),
            color=_colour(s.number),
            alpha=0.28,
            linewidth=0.0,
            rcount=90,
            ccount=40,
        )
        ax.plot(*s.backbone.positions.T, color='black', linewidth=1.6)
        ax.plot(*s.backbone.at(knots[1:]).T, 'o', color='black', markersize=4.5)
        for error, at in zip(scored, s.backbone.at(knots[1:]), strict=True):
            ax.text(*at, f'  {error.q3_mm:.1f} mm', fontsize=8.0)
        everything = np.concatenate((surface.reshape(-1, 3), s.backbone.positions))
        middle = 0.5 * (everything.max(axis=0) + everything.min(axis=0))
        half = 0.5 * np.ptp(everything, axis=0).max()
        ax.set(
            xlim=(middle[0] - half, middle[0] + half),
            ylim=(middle[1] - half, middle[1] + half),
            zlim=(middle[2] - half, middle[2] + half),
        )
        ax.set_box_aspect((1.0, 1.0, 1.0), zoom=0.88)
        ax.tick_params(labelsize=7.0, pad=0.0)
        ax.locator_params(nbins=4)
        ax.set_xlabel('x (m)', fontsize=8.0)
        ax.set_ylabel('y (m)', fontsize=8.0)
        ax.set_zlabel('z (m)', fontsize=8.0)
        ax.set_title(s.name, fontweight='bold', fontsize=9.0)
    return figure


def _tube(centres: FloatArray, radii: FloatArray, around: int = 40) -> FloatArray:
    """Rings across a curve, carried along it without twist: (k, around, 3)."""
    tangents = np.gradient(centres, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    least = np.eye(3)[np.argmin(np.abs(tangents[0]))]
    normal = np.cross(tangents[0], least)
    normal /= np.linalg.norm(normal)
    normals = [normal]
    for before, after in pairwise(tangents):
        normals.append(rotate(swing(before, after), normals[-1]))
    across = np.array(normals)
    angle = np.linspace(0.0, 2.0 * np.pi, around)[None, :, None]
    ring = np.cos(angle) * across[:, None] + np.sin(angle) * np.cross(tangents, across)[:, None]
    return centres[:, None] + radii[:, None, None] * ring


def _start(s: Series) -> float:
    starts = [e.times[0] for e in s.errors.values() if e.n]
    if s.fitted_on is not None:
        starts.append(s.fitted_on[0])
    return float(min(starts, default=0.0))


def _with_breaks(error: MarkerError) -> tuple[FloatArray, FloatArray]:
    """Times and distances with a NaN in every gap, so that no line is drawn across it."""
    steps = np.diff(error.times)
    gaps = (
        np.flatnonzero(steps > LONGEST_STEP * np.median(steps)) + 1 if len(steps) else np.array([], dtype=int)
    )
    return np.insert(error.times, gaps, error.times[gaps]), np.insert(error.distances, gaps, np.nan)


def _mm(error: MarkerError) -> FloatArray:
    return 1e3 * error.distances


def _pct(error: MarkerError) -> FloatArray:
    return 100.0 * error.distances / error.arc_length


def _colour(i: int) -> str:
    return SERIES_COLOURS[i % len(SERIES_COLOURS)]


def _line(i: int) -> str:
    """Another dash where the colours begin again."""
    return ('-', '--', ':', '-.')[i // len(SERIES_COLOURS) % 4]


def _figure(width: float, height: float) -> 'Figure':
    # Figure itself and not pyplot: no window system, no global state.
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout='constrained')
