"""The text of `<model>/robot_description`."""

from sesa2.configuration import Configuration
from sesa2.messages.results import link_names
from sesa2.shape.urdf import robot_description


def describe_robot(c: Configuration, name: str) -> str:
    """URDF of the arm as a model sees it; its joints are those of `<name>/joint_states`.

    The base stands in the world as configured; where an IMU measures it, it turns by joints of its own.

    Parameters
    ----------
    c
        of the estimator.
    name
        of the model.
    """
    model = c.create_model(name)
    markers = zip(c.markers.names, c.markers.positions, strict=True)
    base = None if c.imus.base_id else c.base
    return robot_description(
        name,
        link_names(name, model.n_links),
        model.link_ends,
        c.arm.radius,
        base,
        markers,
        c.arm.frame_prefix,
        c.segments.stretch if c.stretches(name) else None,
    )
