"""A report of one or more evaluations: PNG figures and one page that needs nothing else."""

from collections.abc import Sequence
from pathlib import Path

from sesa2.evaluation import plots
from sesa2.evaluation.drawn_pose import DrawnPose
from sesa2.evaluation.plots import Series
from sesa2.evaluation.report_page import EvaluatedTrial, Figure, page
from sesa2.evaluation.trajectory import EvaluationError
from sesa2.partial_files import whole_folder

__all__ = ['DrawnPose', 'EvaluatedTrial', 'write_report']

PAGE = 'index.html'


def write_report(
    directory: str | Path, trials: Sequence[EvaluatedTrial], title: str = 'Accuracy against motion capture'
) -> Path:
    """Write the figures and the page.

    Parameters
    ----------
    directory
        where; must not exist yet, or be empty. It appears only when it is complete.
    trials
        at least one, with different labels.
    title
        of the page.

    Returns
    -------
    The page.

    Raises
    ------
    EvaluationError
        nothing to report, the directory is taken or cannot be written, or matplotlib is absent.
    """
    directory = Path(directory)
    labels = [trial.label for trial in trials]
    if not labels or len(set(labels)) != len(labels):
        raise EvaluationError(f'trials labelled {labels}, expected at least one, all different')
    plots.require_matplotlib()
    try:
        if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
            raise EvaluationError(f'{directory} exists; give a directory that does not, or an empty one')
        if not directory.parent.exists():
            directory.parent.mkdir(parents=True)
        with whole_folder(directory) as folder:
            figures = _figures(trials)
            for figure in figures:
                (folder / figure.file).write_bytes(figure.png)
            (folder / PAGE).write_text(page(title, trials, figures), encoding='utf-8')
    except OSError as e:
        raise EvaluationError(f'cannot write the report to {directory}: {e.strerror}') from e
    return directory / PAGE


def _series(trials: Sequence[EvaluatedTrial], *, boxes: bool = False) -> list[Series]:
    """Every model of every trial, named by what differs; boxes of several trials stand in one panel per model."""
    several = len(trials) > 1
    series: list[Series] = []
    for trial in trials:
        models = trial.evaluation.models
        for model, errors in models.items():
            name = model if not several else trial.label if boxes else f'{trial.label}, {model}'
            panel = model if several else trial.label
            fitted_on = trial.evaluation.registration.fitted_on
            series.append(Series(name, panel, dict(errors), len(series), fitted_on, trial.backbone))
    return series


def _figures(trials: Sequence[EvaluatedTrial]) -> list[Figure]:
    series = _series(trials)
    figures = [
        Figure(
            'boxes.png',
            'Errors by model and marker',
            'Boxes hold the middle half of the errors, the line is the median, whiskers reach from the 5th to the '
            '95th percentile. Compare with figures 5.3 and 5.4 of the thesis.',
            plots.box_plots(_series(trials, boxes=True)),
        ),
        Figure(
            'along_the_arm.png',
            'Error along the arm',
            'Median at each marker; bars span the middle half. Between the markers nothing was measured: '
            'the lines only guide the eye, and series are drawn a little side by side.',
            plots.error_along_the_arm(series),
        ),
        Figure(
            'over_time.png',
            'Error over time',
            'Every scored sample. Lines are broken where the truth or the estimate has a gap.',
            plots.error_over_time(series),
        ),
    ]
    with_pose = [s for s in series if s.backbone is not None and any(e.n for e in s.errors.values())]
    if with_pose:
        figures.append(
            Figure(
                'hull.png',
                'Three quarters of the estimates',
                'A pose of the arm (black) with the third quartile of the error as a tube around it, as in figure 5.2 '
                'of the thesis. It is measured at the markers (dots); in between its radius is interpolated from zero '
                'at the base, and past the last marker nothing is known.',
                plots.hulls(with_pose),
            )
        )
    return figures
