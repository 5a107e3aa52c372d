import pytest
from made_samples import make_samples, write_samples

from sesa2.bags.writing import new_bag
from sesa2.configuration import validate


@pytest.fixture(scope='session')
def samples():
    """300 sweeps of three IMUs."""
    return make_samples(300)


@pytest.fixture
def bag(tmp_path, samples):
    """These as a bag."""
    with new_bag(tmp_path / 'in') as writer:
        write_samples(writer, samples)
    return tmp_path / 'in'


@pytest.fixture(scope='session')
def configuration():
    """The arm that they sit on."""
    return validate(
        {
            'arm': {'length': 0.3},
            'imus': {'ids': [1, 2, 3], 'positions': [0.1, 0.2, 0.29]},
            'markers': {'names': ['M1', 'M2'], 'positions': [0.15, 0.3]},
            'models': ['rigid', 'pcc'],
        }
    )
