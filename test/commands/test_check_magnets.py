"""`sesa2 check` of arms with magnets."""

import pytest
import yaml

from sesa2.cli import main
from sesa2.configuration import files


def written(tmp_path, name, **changes):
    """A shipped configuration with other values of magnetometers, as a file."""
    document = yaml.safe_load(files.find(name).read_text())
    document['/**']['ros__parameters']['magnetometers'].update(changes)
    path = tmp_path / 'arm.yaml'
    path.write_text(yaml.safe_dump(document))
    return path


def test_the_paper_s_arm(capsys):
    assert main(['check', 'magnetic_3']) == 0
    told = capsys.readouterr()
    assert '12 readings for 9 coordinates, at least 9 are needed' in told.out
    assert 'Without a magnetometer and a magnet on either side: 0.000 to 0.055 m' in told.out
    assert 'no residual tells where that is wrong' in told.err
    assert 'spared: when one fails' not in told.err


def test_an_affine_arm_has_nothing_to_doubt(capsys):
    assert main(['check', 'magnetic_affine']) == 0
    assert capsys.readouterr().err == ''


@pytest.mark.parametrize(
    ('changes', 'doubt'),
    [
        ({'range': 6e-4}, 'readings go up to 1.73 mT, expected less than magnetometers.range, 0.6 mT'),
        ({'masked': [1, 3, 5, 7, 9, 11]}, 'the shapes the readings do not tell something, usually segment_'),
        ({'masked': [4, 8, 12]}, '9 of 9 magnetometers cannot be spared'),
        ({'noise': 1e-4}, '12 readings change by less than 30 times the noise'),
    ],
)
def test_what_is_doubtful(tmp_path, capsys, changes, doubt):
    assert main(['check', str(written(tmp_path, 'magnetic_3', **changes))]) == 0
    assert doubt in capsys.readouterr().err


def test_too_near_when_bent(tmp_path, capsys):
    path = written(tmp_path, 'magnetic_1', positions=[0.0635, 0.0635, 0.11])
    assert main(['check', str(path)]) == 1
    told = capsys.readouterr()
    assert 'too near when the arm is bent' in told.err
    assert 'magnetometer 1 and magnet 1 14.' in told.err
    assert 'Traceback' not in told.err
