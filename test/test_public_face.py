"""What a program that imports sesa2 finds, and what it costs to import."""

import re
import subprocess
import sys
from importlib import import_module
from pkgutil import iter_modules
from xml.etree import ElementTree

import pytest
from processes import REPOSITORY

import sesa2

NODES = (
    'calibration',
    'estimator',
    'field_source',
    'plant',
    'tip_controller',
    'player',
    'recorder',
    'serial_bridge',
    'viewer',
)


def test_every_name_is_there_and_explained():
    for name in sesa2.__all__:
        thing = getattr(sesa2, name)
        assert name == '__version__' or len(thing.__doc__) > 20, name
    assert set(dir(sesa2)) == set(sesa2.__all__)
    with pytest.raises(AttributeError, match="'sesa2' has no attribute 'nonsense'"):
        sesa2.nonsense  # noqa: B018


def loaded_by(code):
    """Modules of others that a fresh Python has loaded after some code."""
    listed = subprocess.run(
        [sys.executable, '-c', f'{code}\nimport sys\nprint(*sys.modules)'],
        capture_output=True,
        text=True,
        check=True,
        cwd=REPOSITORY,
    ).stdout.split()
    return {name.partition('.')[0] for name in listed}


def test_importing_costs_nothing():
    assert not loaded_by('import sesa2') & {'numpy', 'rclpy', 'rosbags', 'yaml', 'serial'}


def test_shapes_need_numpy_alone():
    loaded = loaded_by('import sesa2\nsesa2.create_model("pcc", sesa2.Layout(sesa2.Arm(0.5), (0.5,)))')
    assert 'numpy' in loaded
    assert not loaded & {'rclpy', 'rosbags', 'yaml', 'serial', 'scipy', 'mcap'}


def test_the_version_is_one():
    version = ElementTree.parse(REPOSITORY / 'package.xml').findtext('version')
    assert version == sesa2.__version__
    assert f'\n{version} ' in (REPOSITORY / 'CHANGELOG.rst').read_text()


def test_types_are_announced():
    assert (REPOSITORY / 'sesa2/py.typed').exists()


@pytest.mark.parametrize('name', NODES)
def test_each_node_has_a_script_for_ros2_run(name):
    script = (REPOSITORY / 'scripts' / name).read_text()
    assert f'from sesa2.nodes.{name} import main' in script


def test_nodes_are_all_that_is_in_nodes():
    package = import_module('sesa2.nodes')
    assert {module.name for module in iter_modules(package.__path__)} == set(NODES)


def test_names_of_files_and_classes_are_unique():
    """But for a command or a node, which is named after what it runs."""
    files, classes = {}, {}
    for path in sorted((REPOSITORY / 'sesa2').rglob('*.py')):
        if path.parent.name in ('commands', 'nodes'):
            continue
        name = path.parent.name if path.name == '__init__.py' else path.stem
        assert name not in files or name == 'sesa2', f'{path} and {files[name]}'
        files[name] = path
        for found in re.findall(r'^class (\w+)', path.read_text(), re.M):
            if not found.startswith('_'):
                assert found not in classes, f'class {found} in {path} and {classes[found]}'
                classes[found] = path


def test_the_picture_of_the_imports_in_the_readme_is_that_of_the_code():
    layers = re.search(
        r'type = "layers"\nlayers = \[(.*?)\]', (REPOSITORY / 'pyproject.toml').read_text(), re.S
    )[1]
    kept = [sorted(re.findall(r'sesa2\.(\w+)', line)) for line in layers.strip().splitlines()][::-1]
    picture = re.search(r'^shape ← .*$', (REPOSITORY / 'README.md').read_text(), re.M)[0]
    shown = [sorted(layer.strip().split(', ')) for layer in picture.split('←')]
    packages = [[m for m in layer if m == 'cli' or (REPOSITORY / 'sesa2' / m).is_dir()] for layer in kept]
    assert shown == [layer for layer in packages if layer]  # single files lie below all


def test_the_readmes_python_runs():
    for code in re.findall(r'```python\n(.*?)```', (REPOSITORY / 'README.md').read_text(), re.S):
        exec(compile(code, 'README.md', 'exec'), {})
