"""Packaging of sesa2, for pip and for colcon (ament_python)."""

import re
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

# The one place where the version stands; package.xml has to repeat it, and a test holds the two together.
VERSION = re.search(r"__version__ = '(.+)'", Path('sesa2/__init__.py').read_text(encoding='utf-8'))[1]

ROS = ['ros-jazzy-rclpy[fastrtps]', 'ros-jazzy-common-interfaces', 'ros-sesa2-msgs']

setup(
    name='sesa2',
    version=VERSION,
    description='Proprioception for soft continuum arms from inertial sensors',
    license='Apache-2.0',
    maintainer='Name of who releases this package',
    maintainer_email='put-the-address-of-who-releases-it-here@sesa2.invalid',
    packages=find_packages(include=['sesa2', 'sesa2.*']),
    package_data={'sesa2': ['py.typed']},
    python_requires='>=3.10',
    zip_safe=True,
    install_requires=[
        'setuptools',
        'numpy>=1.26',
        'pyserial>=3.5',
        'cobs>=1.2',
        'PyYAML>=6.0',
        'rosbags>=0.11.7,<0.12',
        'mcap>=1.5,<2',  # with lz4 and zstandard, which it compresses with
    ],
    extras_require={
        'ros': ROS,
        'mocap': ['ezc3d>=1.5.16'],
        'raw': ['vqf>=2.1'],
        'report': ['matplotlib>=3.8'],
        'viewer': ['viser>=1.1,<2'],
        'sim': ['pyelastica>=1.0', 'scipy>=1.11'],
        'mat': ['scipy>=1.11'],
        'test': [
            'pytest>=8',
            'pytest-rerunfailures>=14',
            'hypothesis>=6.100',
            'magpylib>=5.1',
            'scipy>=1.11',
            'c3d>=0.5',
            'evo>=1.28',
            'playwright>=1.40',
            'yourdfpy>=0.0.56',
        ],
        'lint': ['ruff>=0.8', 'mypy>=1.13', 'import-linter>=2.1', 'types-PyYAML', 'types-pyserial'],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/sesa2']),
        ('share/sesa2', ['package.xml']),
        ('share/sesa2/config', glob('config/*')),
        ('lib/sesa2', glob('scripts/*')),
    ],
    entry_points={'console_scripts': ['sesa2 = sesa2.cli:main']},
)
