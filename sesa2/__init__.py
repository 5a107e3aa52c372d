"""Proprioception for soft continuum arms: the arm's shape from sensors along it.

What a program that imports sesa2 calls is named here, and loaded when it is first asked for: `import sesa2` costs
nothing, and the shape models need numpy alone.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sesa2.bags.array_files import write_arrays
    from sesa2.bags.estimate_arrays import EstimateArrays, ModelArrays, read_estimate
    from sesa2.bags.replay import replay
    from sesa2.configuration import Configuration, ConfigurationError
    from sesa2.configuration.files import load_configuration
    from sesa2.errors import Sesa2Error
    from sesa2.estimation.estimator import Estimate, Estimator, ModelResult
    from sesa2.estimation.sweeps import Sweep
    from sesa2.evaluation.bag_evaluation import evaluate_bag as evaluate
    from sesa2.shape.arm import Arm, GeometryError
    from sesa2.shape.backbone import Backbone
    from sesa2.shape.kinematics import create_kinematics
    from sesa2.shape.kinematics.coordinates import Kinematics
    from sesa2.shape.layout import Layout
    from sesa2.shape.measured import Measured
    from sesa2.shape.model import Model
    from sesa2.shape.models import create_model
    from sesa2.shape.options import ModelOptions, parameter

__version__ = '0.2.0'

__all__ = [
    'Arm',
    'Backbone',
    'Configuration',
    'ConfigurationError',
    'Estimate',
    'EstimateArrays',
    'Estimator',
    'GeometryError',
    'Kinematics',
    'Layout',
    'Measured',
    'Model',
    'ModelArrays',
    'ModelOptions',
    'ModelResult',
    'Sesa2Error',
    'Sweep',
    '__version__',
    'create_kinematics',
    'create_model',
    'evaluate',
    'load_configuration',
    'parameter',
    'read_estimate',
    'replay',
    'write_arrays',
]

_HOMES = {
    'Arm': 'shape.arm',
    'Backbone': 'shape.backbone',
    'Configuration': 'configuration',
    'ConfigurationError': 'configuration',
    'Estimate': 'estimation.estimator',
    'EstimateArrays': 'bags.estimate_arrays',
    'Estimator': 'estimation.estimator',
    'GeometryError': 'shape.arm',
    'Kinematics': 'shape.kinematics.coordinates',
    'Layout': 'shape.layout',
    'Measured': 'shape.measured',
    'Model': 'shape.model',
    'ModelArrays': 'bags.estimate_arrays',
    'ModelOptions': 'shape.options',
    'ModelResult': 'estimation.estimator',
    'Sesa2Error': 'errors',
    'Sweep': 'estimation.sweeps',
    'create_kinematics': 'shape.kinematics',
    'create_model': 'shape.models',
    'evaluate': 'evaluation.bag_evaluation:evaluate_bag',
    'load_configuration': 'configuration.files',
    'parameter': 'shape.options',
    'read_estimate': 'bags.estimate_arrays',
    'replay': 'bags.replay',
    'write_arrays': 'bags.array_files',
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    home, _, called = _HOMES[name].partition(':')
    return getattr(import_module(f'{__name__}.{home}'), called or name)


def __dir__() -> list[str]:
    return __all__
