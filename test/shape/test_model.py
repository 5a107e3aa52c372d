"""What every model has in common: one that is written elsewhere is a model like ours."""

from dataclasses import dataclass

import numpy as np
import pytest

from sesa2.configuration import ConfigurationError, files, validate
from sesa2.configuration.description import describe
from sesa2.configuration.records import leaves
from sesa2.estimation.estimator import Estimator
from sesa2.estimation.sweeps import Sweep
from sesa2.shape.arm import Arm, GeometryError
from sesa2.shape.backbone import Backbone
from sesa2.shape.layout import Layout
from sesa2.shape.measured import Measured
from sesa2.shape.model import MODELS, Model
from sesa2.shape.models import create_model
from sesa2.shape.options import ModelOptions, parameter
from sesa2.shape.rotations import IDENTITY, tangent

LAYOUT = Layout(Arm(0.5), (0.25, 0.5))
VALUES = {
    'arm': {'length': 0.5},
    'imus': {'ids': [1, 2], 'positions': [0.25, 0.5]},
    'markers': {'names': ['M'], 'positions': [0.4]},
}


@pytest.fixture
def models():
    """Models that a test defines are gone after it."""
    before = dict(MODELS)
    yield MODELS
    MODELS.clear()
    MODELS.update(before)


class Rod(Backbone):
    """A straight rod."""

    def __init__(self, q, length):
        self._q, self._length = q, length

    def positions(self, s):
        return self._length * np.asarray(s)[:, None] * tangent(self._q)[..., None, :]

    def orientations(self, s):
        return np.repeat(self._q[..., None, :], len(s), axis=-2)


def define_straight(called='straight', own=True):
    """A model of a straight arm that points where its last IMU does; it has no `links`."""

    @dataclass(frozen=True)
    class StraightOptions(ModelOptions):
        stretch: float = parameter(1.0, 'how much longer the arm is than it is at rest', above=0.0, high=2.0)

    class Straight(Model[None]):
        name = called
        Options = StraightOptions if own else ModelOptions

        def __init__(self, layout, options):
            super().__init__(layout, options)
            self._set_link_ends([0.0, layout.arm.length])
            self._stretch = options.stretch if own else 1.0

        def _fit(self, measured):
            return Rod(measured.stations[..., -1, :], self._stretch)

        def _precompute(self, s):
            return None

    return Straight


def test_a_model_of_ones_own_is_one_class(models):
    define_straight()
    c = validate({**VALUES, 'models': ['straight', 'pcc'], 'straight': {'stretch': 1.1}})
    assert 'straight.stretch' in {path for path, _, _ in leaves()}
    assert files.parse(files.dump(c), 'dump') == c
    assert '  straight  1' in describe(c)
    q = np.tile(IDENTITY, (2, 1))
    q[1] = [np.sin(0.3), 0.0, 0.0, np.cos(0.3)]
    result = Estimator(c).estimate([Sweep(5, q, np.ones(2, bool), None)]).models['straight']
    np.testing.assert_allclose(
        result.ends[0, -1], 1.1 * 0.5 * np.array([0, -np.sin(0.6), np.cos(0.6)]), atol=1e-12
    )
    np.testing.assert_allclose(result.markers[0, 0], 0.8 * result.ends[0, -1], atol=1e-12)


def test_its_options_are_checked_like_ours(models):
    define_straight()
    with pytest.raises(ConfigurationError, match=r'got 3\.0, expected more than 0 and at most 2'):
        validate({**VALUES, 'models': ['straight'], 'straight': {'stretch': 3.0}})
    with pytest.raises(
        ConfigurationError, match=r'straight.strech: is not known; did you mean straight.stretch'
    ):
        validate({**VALUES, 'models': ['straight'], 'straight': {'strech': 1.0}})
    with pytest.raises(GeometryError, match="no option 'links', expected some of stretch"):
        create_model('straight', LAYOUT, links=4)


def test_a_model_without_options_has_no_section(models):
    define_straight(own=False)
    assert not [path for path, _, _ in leaves() if path.startswith('straight')]
    assert validate({**VALUES, 'models': ['straight']}).create_model('straight').n_links == 1


@pytest.mark.parametrize('called', ['serial', 'links', 'options'])
def test_a_model_named_as_a_key_of_the_configuration_is_refused(models, called):
    define_straight(called)
    with pytest.raises(GeometryError, match=f"a model cannot be named '{called}'"):
        validate({**VALUES, 'models': ['pcc']})


def test_names_that_topics_cannot_have_are_refused(models):
    with pytest.raises(GeometryError, match="model 'My Model': expected a name in lower case"):
        define_straight('My Model')


def test_two_models_of_one_name_are_refused(models):
    with pytest.raises(GeometryError, match=r"model 'pcc' of .*: sesa2\.shape\.models\.pcc has"):
        define_straight('pcc')


def test_what_a_model_needs_must_have_been_measured():
    with pytest.raises(GeometryError, match="model 'pcc' needs orientations, and there are none"):
        create_model('pcc', LAYOUT).fit(Measured())


def test_sections_of_models_that_are_not_run_are_checked_too():
    with pytest.raises(ConfigurationError, match=r'pcc.segments\[1\]: got 0'):
        validate({**VALUES, 'models': ['rigid'], 'pcc': {'segments': [2, 0]}})
