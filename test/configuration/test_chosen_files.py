"""Files chosen from afar stay under one folder, whatever links and dots say."""

import pytest

from sesa2.configuration import validate
from sesa2.configuration.chosen_files import FILES, ChosenFiles
from sesa2.configuration.records import leaves
from sesa2.errors import Sesa2Error


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / 'lab/deep').mkdir(parents=True)
    (tmp_path / 'lab2').mkdir()
    (tmp_path / 'secret.yaml').write_text('')
    (tmp_path / 'lab/out').symlink_to(tmp_path)
    (tmp_path / 'lab/in').symlink_to(tmp_path / 'lab/deep')
    (tmp_path / 'lab/loop').symlink_to('loop')
    monkeypatch.chdir(tmp_path / 'lab')
    return tmp_path / 'lab'


@pytest.mark.parametrize('name', ['a', 'deep/a', './deep/../a', 'in/a', 'deep/new/a'])
def test_what_is_under_the_folder(folder, name):
    ChosenFiles(folder).check(name)
    ChosenFiles(folder).check(folder / name)
    ChosenFiles(folder.parent / 'lab/out/lab').check(name)


@pytest.mark.parametrize(
    'name',
    ['..', '../a', '../lab2/a', 'deep/../../a', 'out/secret.yaml', '/etc/passwd', '/', 'a\0b', 'loop/a'],
)
def test_what_is_not(folder, name):
    with pytest.raises(Sesa2Error, match=f'is not under {folder}'):
        ChosenFiles(folder).check(name)


def test_the_root_allows_all(folder):
    ChosenFiles('/').check('../../a')


def configuration(**files):
    values = {'arm': {'length': 0.3}, 'imus': {'ids': [1], 'positions': [0.3]}}
    for path, name in files.items():
        section, _, key = path.partition('__')
        values.setdefault(section, {})[key] = name
    return validate(values)


def test_what_was_named_at_the_start_may_be_anywhere_for_what_it_was_named_for(folder):
    chosen = ChosenFiles(folder)
    chosen.allow(configuration(run__bag='/data/bag', record__file='../out'))
    assert chosen.mistakes(configuration(run__bag='/data/bag', record__file='../out')) == []
    assert chosen.mistakes(configuration()) == []
    [mistake] = chosen.mistakes(configuration(record__file='/data/bag', run__bag='deep/bag'))
    assert mistake.place == 'record.file'
    assert '--files' in mistake.message


def test_every_parameter_that_names_a_file_is_kept_there():
    named = {
        path for path, _, _ in leaves() if path.split('.')[-1] in ('file', 'bag', 'trial', 'path', 'folder')
    }
    assert named == set(FILES)
