"""A run of an arm with magnets and no IMUs: which nodes, and what cannot be simulated."""

from dataclasses import replace

import pytest
from magnetic_bag import configuration

from sesa2.configuration import ConfigurationError, files, validate
from sesa2.errors import Sesa2Error
from sesa2.nodes.estimator import EstimatorNode
from sesa2.nodes.field_source import FieldSource
from sesa2.system.terminal import Terminal
from sesa2.system.wiring import System


@pytest.fixture
def system(graph):
    one = System(graph._spinner)
    yield one
    one.end()


def test_the_source_sim_plays_it(graph, system, capsys):
    c = configuration()
    system.start(replace(c, field_source=replace(c.field_source, build_errors=0.0, rate=20.0)))
    assert [type(node) for node in system.nodes] == [EstimatorNode, FieldSource]
    graph.until(lambda: system.estimator.fields.n_sweeps > 5, 'results')
    terminal = Terminal(system)
    terminal.show_when_due()
    said = capsys.readouterr().out
    assert 'of 12 | magnetic tip' in said
    assert float(said.split('(')[1].split(' mm off')[0]) < 20.0
    terminal.show_summary()
    assert 'sweeps estimated' in capsys.readouterr().out
    assert system.unheard == ''


def test_of_an_external_source_that_is_silent_it_is_said_who_is_missing(graph, system):
    c = configuration()
    system.start(replace(c, run=replace(c.run, source='external')))
    assert 'no magnetometer is heard; expected /magnetometer_1/field and so on of' in system.unheard


def test_both_kinds_are_not_simulated(system):
    c = configuration()
    flat = validate(
        {'arm': {'length': 0.33}, 'imus': {'ids': [1], 'positions': [0.33]}, 'models': ['pcc']}
    ).imus
    with pytest.raises(Sesa2Error, match='got one with both'):
        system.start(replace(c, imus=flat))
    assert not system.nodes


def test_a_board_without_imus_is_a_mistake():
    c = configuration()
    with pytest.raises(ConfigurationError, match='there are no IMUs that a board would have'):
        files.parse(files.dump(replace(c, run=replace(c.run, source='serial'))), 'test')
