"""The model on batches of measured fields, as a program uses it: a configuration or a layout, and no more."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from paper_arm import NOISE, PaperArm, errors, flower, lemniscate
from scipy.spatial.transform import Rotation

from sesa2.configuration import files
from sesa2.sensing.magnetometry.magnetic_readings import MagneticReadings
from sesa2.shape.arm import Arm, GeometryError
from sesa2.shape.layout import Layout
from sesa2.shape.measured import Measured
from sesa2.shape.models import create_model
from sesa2.shape.reading_faults import ReadingFault

CONFIG = Path(__file__).parents[2] / 'config'


def layout_of(arm, **changes):
    lengths = tuple(arm.lengths.tolist())
    p = arm.predictor
    make = partial(MagneticReadings, magnets=p.magnets, magnetometers=p.magnetometers, earth_field=arm.earth)
    return Layout(
        Arm(sum(lengths)),
        segment_lengths=lengths,
        bend_max=2.6,
        stretch_limits=(0.95, 1.1),
        n_magnetometers=len(p.names),
        readings=make,
        **changes,
    )


def fields(readings):
    """As drivers give them: axes that are not there are NaN."""
    out = np.full((*readings.shape, 3), np.nan)
    out[..., 2] = readings
    return out


@pytest.mark.parametrize(
    ('name', 'arm', 'motion'),
    [
        ('magnetic_1', PaperArm(1), lemniscate(1, 100)),
        ('magnetic_3', PaperArm(3, 4), lemniscate(3, 100)),
        ('magnetic_affine', PaperArm(1, kinematics='affine'), flower(100)),
    ],
)
def test_shipped_configurations_find_the_shape(name, arm, motion):
    """Simulated by magpylib on another description of the same arm."""
    model = files.load(CONFIG / f'{name}.yaml').create_model('magnetic')
    backbone = model.fit(Measured(fields=fields(arm.simulate(motion)), times=np.arange(100) / 10.0))
    assert backbone.lost is None
    assert not backbone.faults.any()
    assert errors(backbone.coordinates, motion).max() < 0.5
    there = model.kinematics.backbone(motion)
    s = np.linspace(0.0, arm.lengths.sum(), 7)
    np.testing.assert_allclose(backbone.positions(s), there.positions(s), atol=4e-4)
    np.testing.assert_allclose(backbone.lengths, motion[:, model.length_columns], atol=4e-5)


def test_filtered_or_not():
    arm = PaperArm(3, 4)
    q = lemniscate(3, 100)
    u = arm.simulate(q) + NOISE * np.random.default_rng(0).normal(size=(100, 12))
    measured = Measured(fields=fields(u), times=np.arange(100) / 10.0)
    alone = create_model('magnetic', layout_of(arm)).fit(measured)
    filtered = create_model('magnetic', layout_of(arm), filter='constant_velocity').fit(measured)
    for backbone in (alone, filtered):
        assert errors(backbone.coordinates, q).max() < 1.2
        sd = np.sqrt(np.diagonal(backbone.covariance, axis1=1, axis2=2))
        assert 0.8 < np.std((backbone.coordinates - q) / sd) < 1.2
    with pytest.raises(GeometryError, match="'magnetic' needs times"):
        create_model('magnetic', layout_of(arm), filter='random_walk').fit(Measured(fields=fields(u)))


def test_one_by_one_is_as_a_batch():
    arm = PaperArm(1)
    u = arm.simulate(lemniscate(1, 30)) + NOISE * np.random.default_rng(0).normal(size=(30, 3))
    whole = create_model('magnetic', layout_of(arm)).fit(Measured(fields=fields(u))).coordinates
    model = create_model('magnetic', layout_of(arm))
    single = [model.fit(Measured(fields=fields(each))).coordinates for each in u]
    np.testing.assert_allclose(single, whole, rtol=0.0, atol=1e-5)


def test_the_base_turns_shape_and_earth():
    arm = PaperArm(1, earth=(20e-6, -10e-6, 45e-6))
    q = lemniscate(1, 20)
    bases = Rotation.random(20, rng=np.random.default_rng(1)).as_quat()
    model = create_model('magnetic', layout_of(arm))
    backbone = model.fit(Measured(fields=fields(arm.simulate(q, bases)), base=bases))
    assert errors(backbone.coordinates, q).max() < 0.1
    at_rest = model.kinematics.backbone(q)
    s = [0.05, 0.11]
    turned = Rotation.from_quat(np.repeat(bases, 2, axis=0)).apply(at_rest.positions(s).reshape(-1, 3))
    np.testing.assert_allclose(backbone.positions(s).reshape(-1, 3), turned, atol=1e-4)
    expected = Rotation.from_quat(bases) * Rotation.from_quat(at_rest.orientations(s)[:, 1])
    assert (expected.inv() * Rotation.from_quat(backbone.orientations(s)[:, 1])).magnitude().max() < 1e-3


def test_what_failed_and_what_nobody_tells():
    arm = PaperArm(3, largest=2e-3)
    q = lemniscate(3, 6)
    u = arm.simulate(q)
    u[1, 4] = np.nan
    u[2, 0] = -2e-3
    u[3] = np.nan
    model = create_model('magnetic', layout_of(arm))
    backbone = model.fit(Measured(fields=fields(u)))
    assert backbone.faults[1].tolist() == [0, 0, 0, 0, ReadingFault.SILENT, 0, 0, 0, 0]
    assert backbone.faults[2].tolist() == [ReadingFault.SATURATED, *[0] * 8]
    assert (backbone.faults[3] == ReadingFault.SILENT).all()
    assert backbone.lost.tolist() == [False, False, False, True, False, False]
    assert np.isnan(backbone.positions([0.33])[3]).all()
    assert np.isnan(backbone.covariance[3]).all()
    assert np.isfinite(np.delete(backbone.positions([0.33]), 3, axis=0)).all()
    assert [len(backbone.untold(i)) for i in range(6)] == [0, 1, 1, 9, 0, 0]
    assert any(name.startswith('segment_2') for name in backbone.untold(1)[0].names)


def test_links_stretch_with_one_segment_each():
    model = create_model('magnetic', layout_of(PaperArm(3)), links=64)
    assert model.n_links == 66
    assert {0.11, 0.22} <= set(np.round(model.link_ends, 9).tolist())
    assert create_model('magnetic', layout_of(PaperArm(3)), links=3).n_links == 3


def test_what_it_cannot_do_without():
    with pytest.raises(GeometryError, match='0 magnetometers and 0 segments'):
        create_model('magnetic', Layout(Arm(0.3), (0.1,)))
    model = create_model('magnetic', layout_of(PaperArm(1)))
    with pytest.raises(GeometryError, match='needs fields'):
        model.fit(Measured())
    with pytest.raises(GeometryError, match=r'fields of shape \(2, 3\), expected \(..., 3, 3\)'):
        model.fit(Measured(fields=np.zeros((2, 3))))
