"""Recordings of IMUs that say that they give no orientation: refused with the remedy, or fused."""

from dataclasses import replace
from importlib.util import find_spec

import pytest

from sesa2.bags.reading import read_poses
from sesa2.cli import main
from sesa2.configuration import files

CASE = '01-no-orientation'
needs_vqf = pytest.mark.skipif(find_spec('vqf') is None, reason='vqf is not installed (extra raw)')


def configured(path, fusion):
    c = files.load_configuration('prototype3_4')
    path.write_text(files.dump(replace(c, imus=replace(c.imus, fusion=fusion))))
    return str(path)


def test_the_case_makes_no_sweep_and_no_bag(cases, tmp_path, capsys):
    arguments = [
        'replay',
        str(cases / CASE / 'bag'),
        '--config',
        'prototype3_4',
        '--out',
        str(tmp_path / 'out'),
    ]
    assert main(arguments) == 1
    error = capsys.readouterr().err
    assert '240 samples not used: the driver says that it gives no orientation' in error
    assert 'orientation_covariance[0] is −1' in error
    assert 'imus.fusion: 6d' in error
    assert not (tmp_path / 'out').exists()


def test_nor_is_anything_aligned_by_it(cases, tmp_path, capsys):
    out = tmp_path / 'aligned.yaml'
    assert main(['align', str(cases / CASE / 'bag'), '--config', 'prototype3_4', '--out', str(out)]) == 1
    assert '240 samples not used: the driver says' in capsys.readouterr().err
    assert not out.exists()


@needs_vqf
def test_the_case_is_fused_where_that_is_asked_for(cases, tmp_path, capsys):
    config, out = configured(tmp_path / 'arm.yaml', '6d'), tmp_path / 'out'
    assert (
        main(['replay', str(cases / CASE / 'bag'), '--config', config, '--models', 'pcc', '--out', str(out)])
        == 0
    )
    warnings = [line for line in capsys.readouterr().err.splitlines() if line.startswith('warning')]
    assert len(warnings) == 1  # of headings that nobody has aligned yet
    assert 'sesa2 align --headings' in warnings[0]
    assert len(read_poses(out, 'pcc/markers').times_s) == 60
