import re
import sys
from html.parser import HTMLParser

import numpy as np
import pytest

from sesa2.evaluation.evaluate import evaluate
from sesa2.evaluation.report import DrawnPose, EvaluatedTrial, write_report
from sesa2.evaluation.trajectory import EvaluationError, Trajectory

ARC_LENGTHS = {'M1': 0.36, 'M2': 0.60}
ANGLE = np.linspace(0.0, 1.2, 34)
BACKBONE = DrawnPose(
    0.55 * ANGLE, 0.55 * np.stack((1.0 - np.cos(ANGLE), np.zeros(34), np.sin(ANGLE)), axis=1)
)
FIGURES = {'boxes.png', 'along_the_arm.png', 'over_time.png', 'hull.png'}

matplotlib = pytest.importorskip('matplotlib', reason='reports need the extra "report" (matplotlib)')


@pytest.fixture
def trial(motion):
    def make(label, noise, register='rigid', backbone=BACKBONE, models=('rigid', 'pcc')):
        clean, rng = motion.record(31.0), np.random.default_rng(0)
        estimates = {
            model: Trajectory(
                clean.times,
                clean.positions + rng.normal(0.0, noise * (i + 1), clean.positions.shape),
                clean.names,
            )
            for i, model in enumerate(models)
        }
        truth = motion.record(100.0)
        return EvaluatedTrial(label, evaluate(estimates, truth, ARC_LENGTHS, register=register), backbone)

    return make


class Page(HTMLParser):
    """What a browser would see: text, and everything it would fetch."""

    def __init__(self, html):
        super().__init__()
        self.text, self.fetched, self.open = '', [], []
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        if tag not in ('meta', 'img', 'br', 'link'):
            self.open.append(tag)
        self.fetched += [value for name, value in attrs if name in ('src', 'href')]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data + ' '


def test_one_trial(tmp_path, trial):
    one = trial('8 IMUs', 3e-3)
    path = write_report(tmp_path / 'deep' / 'report', [one])
    assert path == tmp_path / 'deep' / 'report' / 'index.html'
    assert {p.name for p in path.parent.iterdir()} == FIGURES | {'index.html'}
    for name in FIGURES:
        assert (path.parent / name).read_bytes().startswith(b'\x89PNG\r\n\x1a\n')
    assert [p.name for p in (tmp_path / 'deep').iterdir()] == ['report']  # nothing half-done is left

    page = Page(path.read_text(encoding='utf-8'))
    assert not page.open
    assert len(page.fetched) == len(FIGURES)
    assert all(source.startswith('data:image/png;base64,') for source in page.fetched)
    text = re.sub(r'\s+', ' ', page.text)
    for model in ('rigid', 'pcc'):
        error = one.evaluation.models[model]['M2']
        assert f'{error.median_mm:.1f} {error.q3_mm:.1f} {error.rmse_mm:.1f} {error.n}' in text
        assert f'{error.median_pct:.2f} {error.q3_pct:.2f} {error.rmse_pct:.2f} {error.n}' in text
    assert 'found from the motion with rigid' in text
    assert re.search(
        r'rigid: rotation by 0\.\d\d° about \(.*\), translation .* mm; fitted with rigid on 0\.0\d to (29|30)\.\d\d s',
        text,
    )


def test_times_are_from_the_beginning_of_the_truth(tmp_path, motion):
    truth, start = motion.record(100.0), 1.7e9
    later = Trajectory(truth.times + start, truth.positions, truth.names)
    result = evaluate({'pcc': motion.record(31.0)}, later, ARC_LENGTHS, register='rigid', time_offset=start)
    html = write_report(tmp_path / 'r', [EvaluatedTrial('a', result)]).read_text(encoding='utf-8')
    assert re.search(r'fitted with pcc on 0\.00 to (29|30)\.\d\d s', html)
    assert re.search(r'(29|30)\.\d\d to 59\.\d\d s of the truth', html)


def test_a_series_keeps_its_colour_beside_a_trial_without_a_pose(tmp_path, trial, monkeypatch):
    drawn = []
    monkeypatch.setattr('sesa2.evaluation.plots.hulls', lambda series: drawn.extend(series) or b'')
    write_report(tmp_path / 'r', [trial('a', 3e-3, backbone=None), trial('b', 3e-3)])
    assert [s.number for s in drawn] == [2, 3]


def test_nothing_is_fetched_from_elsewhere(tmp_path, trial):
    html = write_report(tmp_path / 'r', [trial('a', 3e-3)]).read_text(encoding='utf-8')
    without_images = re.sub(r'base64,[A-Za-z0-9+/=]+', '', html)
    assert not re.search(r'https?:|//|@import|url\(|<script|<link', without_images)


def test_several_trials_side_by_side(tmp_path, trial):
    trials = [trial('2 IMUs', 2e-2), trial('4 IMUs', 1e-2), trial('8 IMUs', 3e-3, backbone=None)]
    page = Page(write_report(tmp_path / 'r', trials).read_text(encoding='utf-8'))
    text = re.sub(r'\s+', ' ', page.text)
    assert 'rigid (8 IMUs), with a median error of' in text
    assert text.count('2 IMUs') >= 5


def test_without_a_pose_there_is_no_hull(tmp_path, trial):
    path = write_report(tmp_path / 'r', [trial('a', 3e-3, register='none', backbone=None)])
    assert {p.name for p in path.parent.iterdir()} == (FIGURES - {'hull.png'}) | {'index.html'}
    assert 'none: the frames were taken to be the same' in path.read_text(encoding='utf-8')


def test_what_was_wrong_stands_on_the_page(tmp_path, motion):
    truth = motion.record(100.0)
    p = 1e3 * truth.positions
    p[100:150] = p[100:150, ::-1]
    p[4000:4500, 0] = np.nan
    wrong = Trajectory(truth.times, p, truth.names)
    result = evaluate({'<pcc>': motion.record(31.0)}, wrong, ARC_LENGTHS, time_offset=0.0)
    html = write_report(tmp_path / 'r', [EvaluatedTrial('a & b', result)]).read_text(encoding='utf-8')
    assert 'The truth is in millimetres; it was converted to metres.' in html
    assert '50 samples of M1 exchanged with another marker' in html
    assert '+0.0000 s, as given' in html
    assert '&lt;pcc&gt;' in html
    assert '<pcc>' not in html
    assert 'a &amp; b' in html


def test_a_marker_without_figures_has_dashes(tmp_path, motion):
    truth = motion.record(100.0)
    p = truth.positions.copy()
    p[2900:, 0] = np.nan
    result = evaluate(
        {'pcc': motion.record(31.0)},
        Trajectory(truth.times, p, truth.names),
        ARC_LENGTHS,
        register='translation',
    )
    html = write_report(tmp_path / 'r', [EvaluatedTrial('a', result, BACKBONE)]).read_text(encoding='utf-8')
    assert '<td class="first">–</td><td>–</td><td>–</td><td>0</td>' in html
    assert 'pcc has nothing to score at M1.' in html


def test_an_empty_directory_will_do_and_a_full_one_is_kept(tmp_path, trial):
    one = trial('a', 3e-3)
    (tmp_path / 'empty').mkdir()
    write_report(tmp_path / 'empty', [one])
    with pytest.raises(EvaluationError, match=r'empty exists; give a directory that does not'):
        write_report(tmp_path / 'empty', [one])
    (tmp_path / 'file').write_text('mine')
    with pytest.raises(EvaluationError, match='file exists'):
        write_report(tmp_path / 'file', [one])
    with pytest.raises(EvaluationError, match=r'cannot write the report to .*: Not a directory'):
        write_report(tmp_path / 'file' / 'report', [one])
    assert (tmp_path / 'file').read_text() == 'mine'


def test_a_failure_leaves_nothing_behind(tmp_path, trial, monkeypatch):
    def broken(*_):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr('sesa2.evaluation.report.page', broken)
    with pytest.raises(EvaluationError, match='No space left'):
        write_report(tmp_path / 'r', [trial('a', 3e-3)])
    assert list(tmp_path.iterdir()) == []


def test_refuses_labels_that_tell_nothing_apart(tmp_path, trial):
    one = trial('a', 3e-3)
    with pytest.raises(EvaluationError, match=r"labelled \['a', 'a'\]"):
        write_report(tmp_path / 'r', [one, one])
    with pytest.raises(EvaluationError, match=r'labelled \[\]'):
        write_report(tmp_path / 'r', [])


def test_without_matplotlib_it_says_what_to_install(tmp_path, trial, monkeypatch):
    monkeypatch.setitem(sys.modules, 'matplotlib', None)
    with pytest.raises(EvaluationError, match=r"pip install 'sesa2\[report\]'"):
        write_report(tmp_path / 'r', [trial('a', 3e-3)])
    assert list(tmp_path.iterdir()) == []


def test_the_style_stays_in_the_report(tmp_path, trial):
    before = dict(matplotlib.rcParams)
    write_report(tmp_path / 'r', [trial('a', 3e-3)])
    assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize(
    ('s', 'p'), [([0.0], [[0, 0, 0]]), ([0, 0], np.zeros((2, 3))), ([0, 1], np.zeros((3, 3)))]
)
def test_refuses_a_backbone_that_is_none(s, p):
    with pytest.raises(EvaluationError, match='backbone with arc lengths'):
        DrawnPose(s, p)
