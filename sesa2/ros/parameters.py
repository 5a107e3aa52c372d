"""The configuration as ROS parameters: read, validated as a whole, and shown described and ranged."""

import sys
from collections.abc import Collection, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from sesa2.configuration import Configuration, validate
from sesa2.configuration.records import leaves

# The file that the configuration came from, which `sesa2 run` tells its nodes.
ORIGIN = 'configuration_file'
# What rclpy declares on its own account, and `sesa2 run`.
_NOT_OURS = ('use_sim_time', 'start_type_description_service', 'qos_overrides', ORIGIN)


def overrides(configuration: Configuration) -> list[Parameter]:
    """The configuration as parameter overrides of a node in this process."""
    # An empty list has no type that ROS could keep; the node fills it in again.
    return [Parameter(path, value=_plain(v)) for path, v in configuration.flat().items() if v != ()]


def declare_configuration(node: Node, changing: Collection[str] = ()) -> Configuration:
    """Read the node's parameters as one configuration, and declare them all.

    The node must have been made with `automatically_declare_parameters_from_overrides`, so that keys which nobody knows
    are seen and refused instead of vanishing.

    Parameters
    ----------
    node
        the node.
    changing
        names of parameters that the node itself changes while it runs; it has to refuse what others want to set.

    Raises
    ------
    ConfigurationError
        with every mistake.
    """
    values: dict[str, Any] = {}
    given: Mapping[str, Any] = node.get_parameters_by_prefix('')  # declared of values, and gives parameters
    for name, parameter in given.items():
        if name.split('.')[0] not in _NOT_OURS:
            section, _, key = name.rpartition('.')
            (values.setdefault(section, {}) if section else values)[key] = _value(parameter)
    configuration = validate(values, f'parameters of {node.get_name()}')
    flat = configuration.flat()
    for path, kind, item in leaves():
        descriptor = _describe(kind, item.metadata, path not in changing)
        if node.has_parameter(path):
            node.set_descriptor(path, descriptor)
        elif flat[path] != ():
            node.declare_parameter(path, _plain(flat[path]), descriptor, ignore_override=True)
    return configuration


def origin_of(node: Node) -> Path | None:
    """The file that a node's configuration came from: as `sesa2 run` says, or as the last `--params-file`."""
    if node.has_parameter(ORIGIN):
        return Path(str(node.get_parameter(ORIGIN).value))
    named = [path for flag, path in pairwise(sys.argv) if flag == '--params-file']
    return Path(named[-1]).resolve() if named else None


def _value(parameter: Parameter) -> Any:
    value = parameter.value
    return list(value) if parameter.type_.name.endswith('_ARRAY') else value


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _describe(kind: Any, rule: Any, read_only: bool) -> ParameterDescriptor:
    """Nearly all are read-only: links never change while running, so a change is a restart."""
    descriptor = ParameterDescriptor(description=rule['meaning'], read_only=read_only, dynamic_typing=True)
    if rule['choices']:
        descriptor.additional_constraints = 'one of ' + ', '.join(map(str, rule['choices']))
    low = rule['low'] if rule['low'] is not None else rule['above']
    if low is not None:
        if kind is float:
            high = rule['high'] if rule['high'] is not None else 1e9
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=float(low), to_value=float(high))
            ]
        elif kind is int:
            high = int(rule['high']) if rule['high'] is not None else 2**31 - 1
            descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=high, step=1)]
    return descriptor
