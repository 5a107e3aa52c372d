"""The report's page: one file of HTML."""

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from sesa2.evaluation.accuracy import MarkerError
from sesa2.evaluation.drawn_pose import DrawnPose
from sesa2.evaluation.evaluate import Evaluation

CSS = """
:root { color-scheme: light; }
body { font: 15px/1.55 system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', sans-serif; color: #1d2733;
       background: #f4f6f8; margin: 0; }
main { max-width: 1060px; margin: 0 auto; padding: 2.2rem 1.4rem 4rem; }
h1 { font-size: 1.7rem; margin: 0 0 .3rem; }
h2 { font-size: 1.15rem; margin: 0 0 .6rem; }
section { background: #fff; border: 1px solid #dfe4ea; border-radius: 8px; padding: 1.2rem 1.4rem; margin: 1.2rem 0; }
p { margin: .4rem 0; max-width: 78ch; }
.lead, .note, figcaption { color: #566370; }
.note, figcaption { font-size: .87rem; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: .5rem 0; }
th, td { padding: .32rem .8rem; text-align: right; border-bottom: 1px solid #e6eaee; white-space: nowrap; }
th { font-weight: 600; color: #3c4854; }
th[scope=colgroup] { text-align: center; border-bottom: 2px solid #c9d2db; }
th[scope=row], td.text { text-align: left; }
td.text { white-space: normal; }
td.first, th.first { border-left: 1px solid #dfe4ea; }
strong.best { color: #12703f; }
figure { margin: .4rem 0 0; }
img { max-width: 100%; height: auto; display: block; }
ul.warnings { background: #fff6e0; border-left: 4px solid #e0a417; border-radius: 4px;
              padding: .6rem 1rem .6rem 2rem; margin: .8rem 0 0; }
@media print { body { background: #fff; } section { break-inside: avoid; border: 0; padding: 0; } }
"""
DEFINITIONS = """
<p>An error is the distance between the estimated and the measured position of a marker; in per cent it is divided
by the marker's arc length from the base. Estimates were interpolated linearly to the times of the measurement, never
across a gap. Q<sub>3</sub>, the third quartile, holds three errors of four; RMSE is the root of the mean square;
n is the number of measured positions that were scored.</p>
"""


@dataclass(frozen=True, eq=False)
class EvaluatedTrial:
    """One evaluation of the report.

    Attributes
    ----------
    label
        what tells it from the others, e.g. `4 IMUs`.
    evaluation
        its result.
    backbone
        a pose to draw the error around, in any frame; without it there is no such figure.
    """

    label: str
    evaluation: Evaluation
    backbone: DrawnPose | None = None


@dataclass(frozen=True)
class Figure:
    """A PNG of the report and what the reader is told about it."""

    file: str
    title: str
    caption: str
    png: bytes


def page(title: str, trials: Sequence[EvaluatedTrial], figures: Sequence[Figure]) -> str:
    """The page as HTML: tables, what was removed, figures inlined; it asks the network for nothing."""
    sections = [
        f'<section><h2>Absolute error</h2>{_table(trials, ("median_mm", "q3_mm", "rmse_mm"), "mm", ".1f")}</section>',
        f'<section><h2>Relative error</h2>{_table(trials, ("median_pct", "q3_pct", "rmse_pct"), "%", ".2f")}</section>',
        f'<section><h2>What the figures mean</h2>{DEFINITIONS}</section>',
        f'<section><h2>What was removed first</h2>{_removed(trials)}</section>',
        *(
            f'<section><h2>{escape(f.title)}</h2><figure><img alt="{escape(f.title)}" src="data:image/png;base64,'
            f'{base64.b64encode(f.png).decode()}"><figcaption>{escape(f.caption)}</figcaption></figure></section>'
            for f in figures
        ),
    ]
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<title>{escape(title)}</title><style>{CSS}</style></head>\n<body><main>\n<h1>{escape(title)}</h1>\n'
        f'<p class="lead">{escape(_summary(trials))}</p>\n'
        + '\n'.join(sections)
        + '\n</main></body></html>\n'
    )


def _summary(trials: Sequence[EvaluatedTrial]) -> str:
    """Name the best model at the marker farthest out."""
    scored = [
        (error.arc_length, error.median_pct, name, error, trial.label, model)
        for trial in trials
        for model, errors in trial.evaluation.models.items()
        for name, error in errors.items()
        if error.n
    ]
    farthest = max(s[0] for s in scored)
    _, _, name, error, label, model = min((s for s in scored if s[0] == farthest), key=lambda s: s[1])
    who = f'{model} ({label})' if len(trials) > 1 else model
    return (
        f'Nearest at {name}, {1e3 * farthest:.0f} mm from the base: {who}, with a median error of '
        f'{error.median_mm:.1f} mm, {error.median_pct:.2f} % of the arc length.'
    )


def _table(trials: Sequence[EvaluatedTrial], figures: tuple[str, str, str], unit: str, digits: str) -> str:
    """Tables 3 and 4 of the thesis: one line a model, three figures and n a marker; the best median stands out."""
    rows = [
        (trial.label, model, errors) for trial in trials for model, errors in trial.evaluation.models.items()
    ]
    arc_lengths = {name: error.arc_length for _, _, errors in rows for name, error in errors.items()}
    best = {
        name: min(
            (round(getattr(e[name], figures[0]), 9) for _, _, e in rows if name in e and e[name].n),
            default=None,
        )
        for name in arc_lengths
    }
    several = len(trials) > 1
    head = ''.join(
        f'<th colspan="4" scope="colgroup" class="first">{escape(name)} ({1e3 * s:.0f} mm)</th>'
        for name, s in arc_lengths.items()
    )
    below = f'<th class="first">median, {unit}</th><th>Q<sub>3</sub></th><th>RMSE</th><th>n</th>' * len(
        arc_lengths
    )
    body = []
    for label, model, errors in rows:
        cells = [f'<th scope="row">{escape(label)}</th>'] if several else []
        cells.append(f'<th scope="row">{escape(model)}</th>')
        for name in arc_lengths:
            cells.extend(_cells(errors.get(name), figures, digits, best[name] if len(rows) > 1 else None))
        body.append(f'<tr>{"".join(cells)}</tr>')
    empty = '<th></th>' * (1 + several)
    return (
        f'<div class="scroll"><table><thead><tr>{empty}{head}</tr><tr>{empty}{below}</tr></thead>'
        f'<tbody>{"".join(body)}</tbody></table></div>'
    )


def _cells(error: MarkerError | None, figures: Iterable[str], digits: str, best: float | None) -> list[str]:
    if error is None or not error.n:
        return ['<td class="first">–</td>', '<td>–</td>', '<td>–</td>', '<td>0</td>']
    values = [getattr(error, figure) for figure in figures]
    texts = [format(value, digits) for value in values]
    if best is not None and round(values[0], 9) == best:
        texts[0] = f'<strong class="best">{texts[0]}</strong>'
    return [
        f'<td class="first">{texts[0]}</td>',
        *(f'<td>{text}</td>' for text in texts[1:]),
        f'<td>{error.n}</td>',
    ]


def _removed(trials: Sequence[EvaluatedTrial]) -> str:
    rows = []
    warnings = []
    for trial in trials:
        evaluation = trial.evaluation
        facts = (
            ('Time offset', _time_offset(evaluation)),
            ('Registration', _registration(evaluation)),
            ('Not applied', _not_applied(evaluation)),
            ('Left out of the truth', _left_out(evaluation)),
            ('Scored', _scored(evaluation)),
        )
        for i, (what, text) in enumerate(facts):
            label = f'<th scope="row" rowspan="{len(facts)}">{escape(trial.label)}</th>' if i == 0 else ''
            rows.append(f'<tr>{label}<th scope="row">{what}</th><td class="text">{escape(text)}</td></tr>')
        prefix = f'{trial.label}: ' if len(trials) > 1 else ''
        warnings += [prefix + warning for warning in evaluation.warnings]
    items = ''.join(f'<li>{escape(warning)}</li>' for warning in warnings)
    listed = f'<ul class="warnings">{items}</ul>' if items else ''
    return (
        f'<div class="scroll"><table>{"".join(rows)}</table></div>'
        f'{listed}'
        '<p class="note">Truth time = estimate time + offset; p<sub>truth</sub> = R p<sub>estimate</sub> + t. '
        'Times are from the beginning of the truth. Offset and registration are shared by all models of a trial, and '
        'each is taken from the model that agrees best.</p>'
    )


def _time_offset(evaluation: Evaluation) -> str:
    offset = evaluation.time_offset
    if offset.correlation is None:
        return f'{offset.seconds:+.4f} s, as given'
    return (
        f'{offset.seconds:+.4f} s, found from the motion with {evaluation.time_offset_from} '
        f'(correlation {offset.correlation:.4f})'
    )


def _registration(evaluation: Evaluation) -> str:
    registration = evaluation.registration
    if registration.fitted_on is None:
        return 'none: the frames were taken to be the same'
    start, end = np.subtract(registration.fitted_on, evaluation.screened.truth.times[0])
    return (
        f'{registration.kind}: {registration.told()}; fitted with '
        f'{evaluation.registration_from} on {start:.2f} to {end:.2f} s, which is not scored'
    )


def _not_applied(evaluation: Evaluation) -> str:
    fit = evaluation.similarity
    if fit is None:
        return 'scale and clock rate: the motion does not tell them'
    return fit.told()


def _left_out(evaluation: Evaluation) -> str:
    screened = evaluation.screened
    parts = [
        f'{n} samples of {name} {why}'
        for why, counts in (
            ('at 0 0 0, where it was not seen', screened.lost),
            ('held at its last position', screened.held),
            ('exchanged with another marker', screened.exchanged),
            ('of which it cannot be told whether they were exchanged', screened.untold),
            ('that jumped', screened.jumped),
        )
        for name, n in counts.items()
        if n
    ]
    if screened.scale != 1.0:
        parts.append(f'nothing else was changed, but for the unit: all of it times {screened.scale:g}')
    return '; '.join(parts) or 'nothing'


def _scored(evaluation: Evaluation) -> str:
    times = [e.times[[0, -1]] for errors in evaluation.models.values() for e in errors.values() if e.n]
    began = evaluation.screened.truth.times[0]
    start, end = min(t[0] for t in times) - began, max(t[1] for t in times) - began
    return f'{start:.2f} to {end:.2f} s of the truth ({end - start:.1f} s)'
