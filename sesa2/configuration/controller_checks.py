"""What can be wrong with the section of the tip controller."""

from collections.abc import Callable

from sesa2.configuration.records import Configuration
from sesa2.control.controller_options import ControllerOptions
from sesa2.errors import Sesa2Error, shown


def check_controller(c: Configuration, expect: Callable[[bool, str, str], bool]) -> None:
    """Note every mistake, in a configuration that has no others.

    Parameters
    ----------
    c
        the configuration.
    expect
        takes whether something is right, and where and what is wrong if it is not; gives the first back.
    """
    k, there = c.controller, c.lengths.names
    if not c.has_controller:
        alone = k == ControllerOptions()
        expect(alone, 'controller.names', 'is missing, and other keys of controller are given')
        return
    if not expect(
        c.has_lengths, 'lengths.names', 'is missing, and controller needs the lengths that it drives'
    ):
        return
    right = True
    for i, name in enumerate(k.names):
        place = f'controller.names[{i}]'
        right &= expect(name in there, place, f'got {shown(name)}, expected one of {", ".join(there)}')
        right &= expect(name not in k.names[:i], place, f'got {shown(name)} a second time')
    known = k.model in c.models
    right &= expect(
        known, 'controller.model', f'got {shown(k.model)}, expected one of models: {", ".join(c.models)}'
    )
    right &= expect(
        not known or bool(c.create_model(k.model).coordinate_names),
        'controller.model',
        f'got {shown(k.model)}, expected a model with coordinates, such as pcc_delta',
    )
    right &= expect(
        c.arm.output_frame == 'base',
        'arm.output_frame',
        f'got {shown(c.arm.output_frame)}, and controller needs base',
    )
    limits = k.length_limits
    right &= expect(
        len(limits) in (0, 2) and sorted(limits) == list(limits),
        'controller.length_limits',
        f'got {shown(list(limits))}, expected two numbers, the smaller first',
    )
    right &= expect(
        k.output == 'joint_trajectory' or not c.has_plant,
        'controller.output',
        f'got {shown(k.output)}, and the simulated arm takes joint_trajectory',
    )
    if right:
        try:
            c.create_controller()
        except Sesa2Error as error:
            expect(False, 'controller', str(error))
