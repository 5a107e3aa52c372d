"""The commands of a desk run where Python has neither the modules of POSIX nor ROS: on Windows, on a Mac."""

import json
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

# Seen by every Python that has the folder in its path: `sitecustomize` is imported before anything else.
BLOCKER = """
    import importlib.abc, os, sys

    ABSENT = {'fcntl', 'grp', 'pty', 'pwd', 'resource', 'rclpy', 'serial', 'termios', 'tty'}

    class Absent(importlib.abc.MetaPathFinder):
        def find_spec(self, name, path=None, target=None):
            if name.partition('.')[0] in ABSENT:
                raise ModuleNotFoundError(f'No module named {name!r}', name=name)

    sys.meta_path.insert(0, Absent())
    for name in ABSENT:
        sys.modules.pop(name, None)
    for name in ('O_DIRECTORY', 'O_NOFOLLOW', 'O_NONBLOCK', 'fchmod', 'getuid', 'geteuid', 'mkfifo'):
        if hasattr(os, name):
            delattr(os, name)
    """


@pytest.fixture(scope='module')
def desk(tmp_path_factory):
    folder = tmp_path_factory.mktemp('desk')
    (folder / 'sitecustomize.py').write_text(textwrap.dedent(BLOCKER))
    package = Path(__file__).resolve().parents[1]

    def sesa2(*arguments, code=0):
        """Output of a command, which has to end as is said."""
        done = subprocess.run(
            [sys.executable, '-m', 'sesa2.cli', *map(str, arguments)],
            cwd=folder,
            env={'PYTHONPATH': f'{folder}:{package}', 'PATH': '', 'HOME': str(folder)},
            capture_output=True,
            text=True,
        )
        assert done.returncode == code, done.stdout + done.stderr
        return done.stdout if code == 0 else done.stderr

    return sesa2


def test_the_blocker_blocks(desk):
    assert "source that of the machine, or pip install 'sesa2[ros]'" in desk(
        'run', '--config', 'prototype3_8', '--source', 'sim', code=1
    )
    assert 'need Linux or macOS: this Python has no module tty' in desk('board', code=1)


def test_from_a_simulated_trial_to_its_figures(desk):
    pytest.importorskip('elastica', reason='pyelastica is not installed: pip install sesa2[sim]')
    assert 'mm' in desk('budget', '--config', 'prototype3_4')
    desk('check', 'prototype3_4')
    desk('twin', '--config', 'prototype3_4', '--out', 'trial', '--seconds', 12)
    desk('align', 'trial', '--self', '--config', 'prototype3_4', '--out', 'calibrated.yaml')
    desk('replay', 'trial', '--config', 'calibrated.yaml', '--models', 'pcc,spline', '--out', 'estimate')
    figures = json.loads(desk('evaluate', 'estimate', '--truth', 'trial', '--json'))
    assert set(figures['models']) == {'pcc', 'spline'}
    desk('export', 'estimate', '--out', 'estimate.csv')
    desk('view', 'estimate', '--html', 'arm.html')
    # A second time over what is there: told, and nothing is lost.
    assert 'estimate' in desk('replay', 'trial', '--config', 'calibrated.yaml', '--out', 'estimate', code=1)
