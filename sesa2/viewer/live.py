"""What is known at the moment about a running system: filled by whoever listens, drawn by the page."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from sesa2.configuration import Configuration
from sesa2.sensing.imu.bno055.scores import Scores
from sesa2.shape.rotations import FloatArray

_HEARD_FOR_S = 3.0  # diagnostics come once a second


class Diagnostic(NamedTuple):
    """What a node says about one of its parts.

    Attributes
    ----------
    level
        0 well, 1 warning, 2 error.
    message, values
        as published.
    heard
        when, s of the monotonic clock.
    """

    level: int
    message: str
    values: Mapping[str, str]
    heard: float


@dataclass
class Live:
    """The newest of everything; positions and orientations are in the frame of the results.

    Attributes
    ----------
    configuration
        in force; None while nothing has been heard.
    backbones, markers
        for each model (n, 7): x y z, m, and orientation x y z w.
    sensors
        q_WS of each IMU by its id, (4,), as long as it measures.
    truth_backbone, truth_markers
        (n, 7), where there is a truth.
    truth_tip : (3,)
        where the tip truly is, m, where there is a truth.
    target : (3,)
        where somebody wants the tip, in base_link, m; each that is heard is an array of its own.
    scores
        calibration of each IMU by its id.
    latency_s
        from the measurement to the arrival of its result, s.
    diagnostics
        by `node: part`.
    """

    configuration: Configuration | None = None
    backbones: dict[str, FloatArray] = field(default_factory=dict)
    markers: dict[str, FloatArray] = field(default_factory=dict)
    sensors: dict[int, FloatArray] = field(default_factory=dict)
    truth_backbone: FloatArray | None = None
    truth_markers: FloatArray | None = None
    truth_tip: FloatArray | None = None
    target: FloatArray | None = None
    scores: dict[int, Scores] = field(default_factory=dict)
    latency_s: float | None = None
    diagnostics: dict[str, Diagnostic] = field(default_factory=dict)

    def hear(self, said: Mapping[str, Diagnostic]) -> None:
        """Take what was said, by `node: part`, and forget what was said long ago: on an open graph names never end."""
        oldest = time.monotonic() - _HEARD_FOR_S
        kept = {name: d for name, d in self.diagnostics.items() if d.heard > oldest}
        self.diagnostics = {**kept, **said}

    def heard(self, node: str) -> dict[str, Diagnostic]:
        """What a node has said within the last seconds, by part; empty when it is silent."""
        oldest = time.monotonic() - _HEARD_FOR_S
        return {
            name.partition(': ')[2]: d
            for name, d in self.diagnostics.items()
            if name.partition(': ')[0] == node and d.heard > oldest
        }

    @property
    def running(self) -> bool:
        """Whether a source of orientations or the estimator speaks."""
        return any(self.heard(node) for node in ('estimator', 'serial_bridge', 'player'))
