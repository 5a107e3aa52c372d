"""The form without a browser: what stands in it is the configuration, and mistakes are beside their fields."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip('viser', reason='viser is not installed: pip install sesa2[viewer]')

from sesa2.configuration import files, validate
from sesa2.configuration.chosen_files import ChosenFiles
from sesa2.configuration.records import leaves
from sesa2.viewer.form import Form
from sesa2.viewer.server import open_server

SHIPPED = sorted(p.stem for p in files.find('prototype3_8').parent.glob('*.yaml'))


@pytest.fixture(scope='module')
def server():
    one = open_server(port=0)
    yield one
    one.stop()


@pytest.fixture
def form(server):
    server.gui.reset()
    one = Form(server.gui, server.gui.add_tab_group(), ChosenFiles('/').mistakes)
    one.fill_in(validate(VALUES))
    return one


VALUES = {
    'arm': {'length': 0.3},
    'imus': {'ids': [2, 5], 'positions': [0.1, 0.3], 'headings': [0.1, -0.2]},
    'markers': {'names': ['A', 'B'], 'positions': [0.1, 0.25]},
    'rigid': {'boundaries': [0.2]},
}


def field(form, path, index=0):
    return [f for f in form._fields if f.path == path][index]


def write(form, path, text, index=0):
    field(form, path, index)._input.value = text
    return form.check()


def beside(form, path, index=0):
    mistake = field(form, path, index)._mistake
    return mistake.content if mistake.visible else ''


@pytest.mark.parametrize('name', SHIPPED)
def test_a_configuration_comes_out_as_it_went_in(server, name):
    server.gui.reset()
    form = Form(server.gui, server.gui.add_tab_group(), ChosenFiles('/').mistakes)
    c = files.load(files.find(name))
    form.fill_in(c)
    assert files.dump(form.check()) == files.dump(c)


def test_every_parameter_is_in_the_form(form):
    there = {f.path for f in form._fields} | {'models'}
    assert there == {path for path, _, _ in leaves()}


def test_lists_and_rules_come_out_as_they_went_in(form):
    c = form.check()
    assert c == validate(VALUES)
    assert write(form, 'rigid.boundaries', 'midpoint').options['rigid'].boundaries == 'midpoint'
    assert write(form, 'arm.base_orientation', '1, 0.0 0 0').arm.base_orientation == (1.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ('path', 'index', 'text', 'message'),
    [
        ('arm.length', 0, '-1', 'got -1.0, expected more than 0'),
        ('arm.length', 0, 'long', 'got &#x27;long&#x27;, expected a number'),
        ('imus.positions', 1, '0.05', '0.05 m is not after 0.1 m'),
        ('imus.ids', 1, '2', 'got 2 a second time'),
        ('imus.ids', 0, '9', 'expected 1 to 8'),
        ('imus.mount_orientations', 1, '0 0 0 2', 'expected a unit quaternion'),
        ('imus.mount_orientations', 1, '0 0 x 1', 'expected a number'),
        ('markers.positions', 1, '0.4', 'beyond the tip'),
        ('markers.names', 1, 'A', 'a second time'),
        ('pcc.segments', 0, '1.5', 'expected an integer'),
        ('serial.baud', 0, '', 'expected an integer'),
    ],
)
def test_a_mistake_stands_beside_its_field_and_nowhere_else(form, path, index, text, message):
    before = field(form, path, index)._input.value
    assert write(form, path, text, index) is None
    assert message in beside(form, path, index)
    others = [f for f in form._fields if f is not field(form, path, index)]
    assert not any(f._mistake.visible for f in others)
    assert form.mistakes
    assert write(form, path, before, index) == validate(VALUES)
    assert not beside(form, path, index)


def test_an_alignment_comes_in_beside_what_is_being_edited(form):
    write(form, 'arm.length', '0.35')
    aligned = validate(VALUES).with_alignment(
        np.array([[0.6, 0.0, 0.0, 0.8], [0.0, 0.8, 0.0, 0.6]]), np.array([0.5, -0.25])
    )
    form.take_alignment(aligned)
    c = form.check()
    assert c.imus.mount_orientations == aligned.imus.mount_orientations
    assert c.imus.headings == aligned.imus.headings
    assert c.arm.length == 0.35


def test_no_model_is_a_mistake(form):
    for box in form._models.values():
        box.value = False
    assert form.check() is None
    assert 'none is chosen' in form._models_mistake.content


def test_before_anything_is_known_the_form_says_so(server):
    server.gui.reset()
    form = Form(server.gui, server.gui.add_tab_group(), ChosenFiles('/').mistakes)
    assert form.check() is None
    assert 'nothing is in the form' in form.mistakes[0].message


def test_one_mounting_for_all_is_written_once(form):
    c = replace(validate(VALUES))
    assert len(c.imus.mount_orientations) == 4
    assert write(form, 'imus.mount_orientations', '1 0 0 0', 1).imus.mount_orientations == (
        0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0,
    )  # fmt: skip
    assert len(write(form, 'imus.mount_orientations', '1 0 0 0', 0).imus.mount_orientations) == 4


def test_a_file_that_may_not_be_chosen_is_refused_beside_its_field(server, tmp_path):
    server.gui.reset()
    chosen = ChosenFiles(tmp_path)
    started_with = validate({**VALUES, 'run': {'trial': '/elsewhere/trial'}})
    chosen.allow(started_with)
    form = Form(server.gui, server.gui.add_tab_group(), chosen.mistakes)
    form.fill_in(started_with)
    assert form.check() == started_with
    for path in ('record.file', 'run.bag', 'calibration.file', 'run.trial'):
        before = field(form, path).value
        assert write(form, path, str(tmp_path / 'a')) is not None
        assert write(form, path, f'{tmp_path}/../b') is None
        assert f'{tmp_path}/../b is not under {tmp_path}' in beside(form, path)
        assert write(form, path, before) == started_with
