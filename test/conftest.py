import os
from pathlib import Path

import pytest


@pytest.fixture(scope='session')
def recordings():
    """Folder of other people's recordings, which are not part of the repository."""
    root = Path(__file__).resolve().parents[1]
    folder = Path(os.environ.get('SESA2_DATA', root.parent / 'shared/data'))
    if not folder.is_dir():
        pytest.skip(f'no recordings in {folder}; SESA2_DATA names their folder')
    return folder
