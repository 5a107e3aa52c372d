"""The budget of shapes from magnetometers, against builds drawn and shapes fitted."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from sesa2.cli import main
from sesa2.configuration import files, validate
from sesa2.errors import Sesa2Error
from sesa2.evaluation.magnetic_budget import BUILD, MICROTESLA, NOISE, STRAIGHT, draw_magnetic_budget
from sesa2.sensing.magnetometry.build_parameters import USUAL_BUILD, BuildErrors, BuildParameters
from sesa2.sensing.magnetometry.magnet_calibration import calibrate_magnets
from sesa2.shape.coordinate_fit import CoordinateFit

# So small that all is linear.
SMALL = BuildErrors(**{name: 0.1 * value for name, value in asdict(USUAL_BUILD).items()} | {'earth': 0.0})


def configured(name, noise=None):
    c = files.load_configuration(name)
    return c if noise is None else replace(c, magnetometers=replace(c.magnetometers, noise=noise))


@pytest.mark.parametrize(('name', 'builds'), [('magnetic_1', 60), ('magnetic_affine', 30)])
def test_as_many_builds_err(name, builds):
    """Before and after a calibration from the straight pose; the noise is averaged out."""
    c = configured(name, noise=0.1e-6)
    budget = draw_magnetic_budget(c, SMALL)
    rng = np.random.default_rng(5)
    q = c.create_model('magnetic').predictor.limits.draw(150, rng)
    # Fitted within wider limits, which take nothing off the errors.
    low, high = c.segments.stretch
    wide = replace(c.segments, bend_max=1.2 * c.segments.bend_max, stretch=(low - 0.05, high + 0.05))
    predictor = replace(c, segments=wide).create_model('magnetic').predictor
    build = BuildParameters(predictor, SMALL)
    straight = np.tile(predictor.limits.kinematics.rest, (50, 1))
    before, after = [], []
    for _ in range(builds):
        real = build.changed(build.deviations * rng.normal(size=len(build.names)))
        read = real.predict(straight).readings + 0.1e-6 * rng.normal(size=(50, len(predictor.noise)))
        calibrated = calibrate_magnets(predictor, straight, read, before=SMALL).predictor
        before.append(CoordinateFit(predictor).fit(real.predict(q).readings).coordinates - q)
        after.append(CoordinateFit(calibrated).fit(real.predict(q).readings).coordinates - q)
    names = [of.replace('_x', '').replace('_y', '') for of in predictor.limits.kinematics.coordinate_names]
    for source, found in ((BUILD, before), (STRAIGHT, after)):
        for k, of in enumerate(budget.coordinate_names):
            own = np.array(found)[..., [i for i, each in enumerate(names) if each == of]]
            expected = np.median(np.sqrt(np.mean(own**2, axis=(0, 2))))
            assert budget.coordinates[source][k] == pytest.approx(expected, rel=0.3), (source, of)


def test_parts_that_are_plain():
    c = configured('magnetic_1')
    budget = draw_magnetic_budget(c)
    np.testing.assert_allclose(budget.coordinates[NOISE], 0.7 * budget.coordinates[MICROTESLA], rtol=1e-12)
    # A pure turn of the last segment moves its tip by no more than its length.
    bend, length = budget.coordinates[NOISE]
    reach = c.arm.length * 1.1 * bend * np.sqrt(2.0) + np.sqrt(3.0) * length
    assert 0.3 * reach < budget.markers[NOISE][0] < reach
    twice = draw_magnetic_budget(c, replace(USUAL_BUILD, gain=0.02))
    ratio = twice.coordinates['gain'] / budget.coordinates['gain']
    np.testing.assert_allclose(ratio, 2.0, rtol=1e-9)
    strong = np.sqrt(sum(budget.coordinates[of] ** 2 for of in ("magnets' strength", "magnets' shift")))
    assert (budget.coordinates[BUILD] > 0.7 * strong).all()


def test_the_command(capsys):
    assert main(['budget', '--config', 'magnetic_3', '--samples', '100']) == 0
    out = capsys.readouterr().out
    assert 'shapes from magnetometers, bent up to 92° a segment' in out
    assert 'build, calibrated straight' in out
    assert main(['budget', '--config', 'magnetic_3', '--samples', '100', '--json']) == 0
    errors = json.loads(capsys.readouterr().out)['magnetic']['errors']
    assert set(errors[NOISE]['markers_mm']) == {'M1', 'M2', 'tip'}
    assert errors[BUILD]['markers_mm']['tip'] > errors[STRAIGHT]['markers_mm']['tip']


def test_imus_beside_have_theirs(capsys, tmp_path):
    document = files.load_configuration('magnetic_1').flat()
    document = {key: list(v) if isinstance(v, tuple) else v for key, v in document.items() if v != ()}
    nested = {}
    for key, value in document.items():
        section, _, name = key.rpartition('.')
        (nested.setdefault(section, {}) if section else nested)[name] = value
    nested['imus'].update(ids=[1, 2], positions=[0.05, 0.11], enabled=[True, True])
    nested['models'] = ['pcc_exact', 'magnetic']
    path = tmp_path / 'both.yaml'
    path.write_text(files.dump(validate(nested)))
    assert main(['budget', '--config', str(path), '--samples', '100', '--json']) == 0
    said = json.loads(capsys.readouterr().out)
    assert set(said['layouts']['configured']) == {'pcc_exact'}
    assert 'errors' in said['magnetic']


def test_what_cannot_be():
    c = configured('magnetic_1')
    with pytest.raises(Sesa2Error, match='samples = 99'):
        draw_magnetic_budget(c, samples=99)
    with pytest.raises(Sesa2Error, match=r'magnetometers\.ids is empty'):
        draw_magnetic_budget(files.load_configuration('prototype3_8'))
    with pytest.raises(Sesa2Error, match='marker M0 is at 0 m'):
        draw_magnetic_budget(replace(c, markers=replace(c.markers, names=('M0',), positions=(0.0,))))
