"""Who steers a run from afar chooses files under one folder; who starts it names any."""

import pytest
from processes import command
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from sesa2.configuration import files, validate
from sesa2.configuration.chosen_files import ChosenFiles
from sesa2.system.remote_control import RemoteControl
from sesa2.system.wiring import System

VALUES = {
    'run': {'source': 'external'},
    'arm': {'length': 0.3},
    'imus': {'ids': [1], 'positions': [0.3]},
    'models': ['pcc'],
}


@pytest.fixture
def remote(graph, tmp_path, monkeypatch):
    (tmp_path / 'here').mkdir()
    monkeypatch.chdir(tmp_path / 'here')
    system = System(graph._spinner, with_page=True)
    values = {**VALUES, 'record': {'file': str(tmp_path / 'named')}}
    node = graph.add(RemoteControl(system, validate(values), ChosenFiles(tmp_path / 'here')))
    yield node
    system.end()


def plan(graph, **record):
    text = files.dump(validate({**VALUES, 'record': record}))
    wanted = [Parameter('configuration', value=text).to_parameter_msg()]
    answer = graph.call(SetParameters, 'system/set_parameters', SetParameters.Request(parameters=wanted))
    return answer.results[0]


def test_a_recording_goes_nowhere_else(graph, remote, tmp_path):
    for name in ('../out', str(tmp_path / 'out'), '/tmp/out'):
        result = plan(graph, file=name)
        assert not result.successful
        assert f'record.file: {name} is not under {tmp_path}/here' in result.reason
    assert plan(graph, file=str(tmp_path / 'named')).successful  # by who started it
    assert plan(graph, file='inside').successful
    assert graph.call(Trigger, 'system/start', Trigger.Request()).success
    assert (tmp_path / 'here/inside').is_dir()
    assert not (tmp_path / 'out').exists()


def test_a_folder_that_is_not_there(tmp_path):
    arguments = ('run', '--config', 'prototype3_8', '--source', 'sim', '--viewer', '0', '--files', 'nowhere')
    with command(tmp_path, *arguments) as program:
        assert program.ended() == 1
        assert '--files nowhere: no such folder' in program.errors
