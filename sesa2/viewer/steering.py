"""What the panel can do to a running system, whoever does it."""

from typing import Protocol

from sesa2.errors import Sesa2Error
from sesa2.shape.rotations import FloatArray


class SteeringError(Sesa2Error):
    """Why the system would not do it, for the user."""


class Steering(Protocol):
    """Starts, stops and asks.

    Each call waits for the answer, a sentence for the user, and raises SteeringError with the reason of a failure.
    """

    @property
    def available(self) -> bool:
        """Whether a system is there that can be started and stopped."""

    def can(self, action: str) -> bool:
        """Whether somebody offers an action of `act`."""

    def start(self, configuration: str) -> str:
        """Start with a configuration, YAML; what runs is stopped first."""

    def record(self, configuration: str) -> str:
        """Record what runs into the file that the configuration, YAML, names."""

    def act(self, action: str) -> str:
        """One of ACTIONS."""

    def aim(self, target: FloatArray, frame: str) -> bool:
        """Say where the tip should go, (3,), m, in a frame of the graph; whether somebody listens.

        This one never waits and fails at nothing.
        """


ACTIONS = (
    'stop',
    'stop_record',
    'align',
    'align_headings',
    'save_calibration',
    'read_offsets',
    'start_control',
    'stop_control',
)
