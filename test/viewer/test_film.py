"""A film, watched in a browser that has no network."""

import numpy as np
import pytest

pytest.importorskip('viser', reason='viser is not installed: pip install sesa2[viewer]')

from sesa2.configuration import validate
from sesa2.errors import Sesa2Error
from sesa2.shape.measured import Measured
from sesa2.shape.models import create_model
from sesa2.shape.rotations import from_rotation_vector
from sesa2.viewer.film import view_html

C = validate(
    {
        'arm': {'length': 0.3, 'radius': 0.012},
        'imus': {'ids': [1], 'positions': [0.3]},
        'markers': {'names': ['M1'], 'positions': [0.2]},
        'models': ['pcc_exact'],
        'links': 32,
    }
)


def recorded(n=41, rate=20.0):
    """An arm that swings from one side to the other."""
    bend = np.zeros((n, 1, 3))
    bend[:, 0, 1] = np.linspace(-1.5, 1.5, n)
    model = create_model('pcc_exact', C.layout, links=C.links)
    fit = model.fit(Measured(from_rotation_vector(bend)))

    def poses(s):
        return np.concatenate([fit.positions(s), fit.orientations(s)], axis=-1)

    return (
        np.arange(n) / rate,
        {'pcc_exact': poses(model.link_ends)},
        {'pcc_exact': poses(C.markers.positions)},
    )


def test_it_plays_by_itself_without_a_network(tab, tmp_path):
    times, backbones, markers = recorded()
    film = tmp_path / 'film.html'
    film.write_text(
        view_html(C, times, backbones, markers, truth_markers=markers['pcc_exact']), encoding='utf-8'
    )
    tab.page.context.set_offline(True)
    tab.open(film.as_uri())

    def middle():
        return tab.where(lambda r, g, b: (g - r > 40) & (g - b > 40))[0]

    first = tab.until(lambda: (x := middle()) == x and x, 'the arm')
    tab.until(lambda: abs(middle() - first) > 15.0, 'its motion')
    assert all(url.startswith(('file:', 'blob:', 'data:')) for url in tab.asked)


def test_more_frames_than_wanted_are_left_out():
    times, backbones, _ = recorded(200, rate=100.0)
    few = view_html(C, times, backbones, frames_per_s=5.0)
    many = view_html(C, times, backbones, frames_per_s=100.0)
    assert len(few) < len(many)


def test_nothing_to_show_is_an_error():
    times, backbones, _ = recorded()
    with pytest.raises(Sesa2Error, match='got nothing'):
        view_html(C, times, {})
    with pytest.raises(Sesa2Error, match='spline'):
        view_html(C, times, {'spline': backbones['pcc_exact']})
