"""A virtual board on a real pseudo-terminal, and a handler that notes what a session tells."""

import threading
import time

import numpy as np
import pytest

from sesa2.link.virtual.motion import ArmMotion
from sesa2.link.virtual.virtual_arm import VirtualArm
from sesa2.link.virtual.virtual_board import VirtualBoard

PATIENCE_S = 30
"""Generous: it is waited for conditions, never for a time."""

IDS = (1, 2, 3, 4)
POSITIONS = np.arange(1, 5) * 0.16


class Recorder:
    """Notes all that a session tells, and wakes whoever waits for something."""

    def __init__(self):
        self.data, self.accelerations, self.fields, self.offsets, self.events = [], [], [], [], []
        self._changed = threading.Condition()

    def on_data(self, data, stamps_ns):
        self._note(self.data, (data, stamps_ns))

    def on_acceleration(self, acceleration, stamps_ns):
        self._note(self.accelerations, (acceleration, stamps_ns))

    def on_magnetic_fields(self, fields, stamps_ns):
        self._note(self.fields, (fields, stamps_ns))

    def on_offsets(self, imu_id, offsets):
        self._note(self.offsets, (imu_id, offsets))

    def on_event(self, event):
        self._note(self.events, event)

    def _note(self, notes, note):
        with self._changed:
            notes.append(note)
            self._changed.notify_all()

    def messages(self, level=None):
        return [event.message for event in self.events if level is None or event.level is level]

    def wait(self, condition):
        """Wait until something is so; looked at whenever anything is told, and now and then."""
        deadline = time.monotonic() + PATIENCE_S
        with self._changed:
            while not condition():
                assert time.monotonic() < deadline, (
                    f'waited {PATIENCE_S} s in vain; events: {self.messages()}'
                )
                self._changed.wait(0.05)

    def wait_for_sweeps(self, count):
        """Wait for further sweeps."""
        wanted = len(self.data) + count
        self.wait(lambda: len(self.data) >= wanted)

    def wait_for_event(self, text):
        self.wait(lambda: any(text in message for message in self.messages()))


@pytest.fixture
def recorder():
    return Recorder()


@pytest.fixture
def make_board(tmp_path):
    """A function that makes virtual boards, closed at the end."""
    boards = []

    def make(ids=IDS, arm=None, **options):
        arm = arm or VirtualArm(ids, ArmMotion(POSITIONS[: len(ids)]))
        options = {'link': tmp_path / 'board', 'boot_s': 0.05, 'calibration_s': 1.0} | options
        boards.append(VirtualBoard(arm, **options))
        return boards[-1]

    yield make
    for board in boards:
        board.close()
