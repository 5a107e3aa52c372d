"""One board's link in a thread of its own: whole sweeps come out of it, and it ends for itself alone."""

import threading
from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sesa2.errors import Sesa2Error
from sesa2.faults import fault_line
from sesa2.link.link_errors import LinkError, ProtocolVersionError
from sesa2.link.packets import Acceleration, Data, MagneticFields, RawData
from sesa2.link.session import LinkSettings, Session
from sesa2.link.status import Event, Level
from sesa2.sensing.imu.bno055.offsets import Offsets


class SweepHandler(Protocol):
    """Whom a link tells, from its thread. It gives no commands itself."""

    def on_sweep(
        self, data: Data | RawData, stamps_ns: list[int], accelerations: NDArray[np.float64] | None
    ) -> None:
        """A sweep, when each of its IMUs was read, and their accelerations where they have come."""

    def on_magnetic_fields(self, fields: MagneticFields, stamps_ns: list[int]) -> None:
        """The magnetic fields of a sweep, and when each was measured."""

    def on_offsets(self, imu_id: int, offsets: Offsets) -> None:
        """What was read from a chip."""

    def on_event(self, event: Event) -> None:
        """Something that the user is to be told."""


class BoardLink:
    """Keeps the link to one board until it is closed.

    Parameters
    ----------
    settings
        Port, IMUs and mode.
    handler
        Whom to tell.
    saved
        Offsets by IMU id.

    Attributes
    ----------
    session
        What the thread runs.
    was_up
        Whether the board has ever streamed: then it is the right one, and worth waiting for.
    failure
        Why the link could not be made at the start, or cannot be kept; None while it can.
    finished
        Whether it has ended for good.
    """

    def __init__(self, settings: LinkSettings, handler: SweepHandler, saved: Mapping[int, Offsets]) -> None:
        self.settings = settings
        self.session = Session(settings, self, saved)
        self.was_up = False
        self.failure: Sesa2Error | None = None
        self.finished = False
        self._handler = handler
        self._waiting: tuple[Data, list[int]] | None = None  # orientations, until their acceleration has come
        self._thread = threading.Thread(target=self._run, name=f'board on {settings.port}', daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def close(self) -> None:
        """End the link and its thread."""
        self.session.stop()
        self._thread.join()

    def _run(self) -> None:
        try:
            self._connect()
            self.session.run()
        except Exception as error:
            if isinstance(error, Sesa2Error):
                self.failure = error
            else:
                self.failure = Sesa2Error(f'board on {self.settings.port}: {fault_line(error)}')
            if self.was_up:
                self.on_event(Event(Level.ERROR, f'{self.failure}; this link has ended'))
        finally:
            self.finished = True

    def _connect(self) -> None:
        try:
            self.session.connect()
        except ProtocolVersionError:
            raise
        except LinkError as error:
            if not self.was_up:
                raise
            self.on_event(Event(Level.ERROR, f'{error}; trying again'))

    # Called by the session, in the thread

    def on_data(self, data: Data | RawData, stamps_ns: list[int]) -> None:
        """Hand a sweep on, or keep it until its acceleration comes."""
        self.was_up = True
        if self._waiting:
            self._handler.on_sweep(*self._waiting, None)
        if isinstance(data, RawData):
            self._waiting = None
            self._handler.on_sweep(data, stamps_ns, data.accelerations)
            return
        self._waiting = (data, stamps_ns) if self.settings.acceleration else None
        if not self._waiting:
            self._handler.on_sweep(data, stamps_ns, None)

    def on_acceleration(self, acceleration: Acceleration, stamps_ns: list[int]) -> None:
        """Hand on the sweep that this acceleration belongs to."""
        del stamps_ns
        if self._waiting and self._waiting[0].sweep.seq == acceleration.sweep.seq:
            self._handler.on_sweep(*self._waiting, acceleration.accelerations)
            self._waiting = None

    def on_magnetic_fields(self, fields: MagneticFields, stamps_ns: list[int]) -> None:
        """Hand them on."""
        self._handler.on_magnetic_fields(fields, stamps_ns)

    def on_offsets(self, imu_id: int, offsets: Offsets) -> None:
        """Hand on what was read from a chip."""
        self._handler.on_offsets(imu_id, offsets)

    def on_event(self, event: Event) -> None:
        """Hand on what the user is to be told."""
        self._handler.on_event(event)
