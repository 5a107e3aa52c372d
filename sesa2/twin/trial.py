"""A trial: the true motion of an arm, what its IMUs measured and what motion capture saw."""

import zipfile
from dataclasses import dataclass, fields
from io import BytesIO
from pathlib import Path

import numpy as np

from sesa2.errors import Sesa2Error
from sesa2.partial_files import write_whole
from sesa2.regular_files import why_no_regular_file
from sesa2.sensing.imu.error_model import orientations_at
from sesa2.shape.rotations import FloatArray


class TrialError(Sesa2Error):
    """A trial that cannot be made, read or written."""


@dataclass(frozen=True)
class Trial:
    """A trial. Positions are in world axes with their origin at the base; quaternions are x y z w.

    Saved as an npz file whose arrays have the names, shapes and units below.

    Attributes
    ----------
    base : (4,)
        q_WB of the clamp.
    times : (n_times,)
        of the true orientations, s, every 5 ms from 0.
    imu_positions : (n_imu,)
        arc lengths of the IMUs, m.
    orientations : (n_times, n_imu, 4)
        true q_WL at the IMUs.
    sensor_ids : (n_sensors,)
        ids of the IMUs along the arm; last, where there is one, of the IMU on the base.
    stamps : (n_sweeps, n_sensors)
        when each sample was read, s. It shows the arm as it was a latency earlier.
    measured : (n_sweeps, n_sensors, 4)
        q_WS as measured.
    mountings : (n_sensors, 3)
        injected mounting errors μ, rad: the true q_LS is exp(μ) ⊗ the configured one.
    headings : (n_sweeps, n_sensors)
        injected heading errors ψ, rad, besides the configured ones.
    truth_times : (n_truth,)
        of the markers, s, 100 Hz.
    marker_names : (n_markers,)
        as configured.
    marker_positions : (n_markers,)
        arc lengths of the markers, m.
    markers : (n_truth, n_markers, 3)
        true positions of the markers, m.
    backbone_times : (n_backbone,)
        s, 10 Hz.
    backbone_positions : (n_nodes,)
        arc lengths of the rod's nodes, m.
    backbone : (n_backbone, n_nodes, 3)
        true positions of the nodes, m.
    energies : (n_times,)
        kinetic, elastic and potential energy of the rod, J; NaN where the arm is no rod.
    """

    base: FloatArray
    times: FloatArray
    imu_positions: FloatArray
    orientations: FloatArray
    sensor_ids: np.ndarray
    stamps: FloatArray
    measured: FloatArray
    mountings: FloatArray
    headings: FloatArray
    truth_times: FloatArray
    marker_names: np.ndarray
    marker_positions: FloatArray
    markers: FloatArray
    backbone_times: FloatArray
    backbone_positions: FloatArray
    backbone: FloatArray
    energies: FloatArray

    def motion(self, t: float | FloatArray) -> FloatArray:
        """True orientations at any time, by slerp; held before the beginning and after the end.

        Parameters
        ----------
        t : scalar or (n,)
            s.

        Returns
        -------
        (n_imu, 4) or (n, n_imu, 4), q_WL, x y z w.
        """
        at = np.broadcast_to(np.asarray(t, dtype=float)[..., None], (*np.shape(t), len(self.imu_positions)))
        return orientations_at(self.times, self.orientations, at)

    def save(self, path: str | Path) -> None:
        """Write a compressed npz file.

        Raises
        ------
        TrialError
            the file exists, or cannot be written.
        """
        content = BytesIO()
        np.savez_compressed(content, **{item.name: getattr(self, item.name) for item in fields(self)})
        try:
            write_whole(path, content.getvalue())
        except FileExistsError:
            raise TrialError(f'{path} exists already') from None
        except OSError as error:
            raise TrialError(f'{path} cannot be written: {error.strerror}') from None

    @classmethod
    def load(cls, path: str | Path) -> 'Trial':
        """Read what `save` wrote.

        Raises
        ------
        TrialError
            the file cannot be read or is no trial.
        """
        names = [item.name for item in fields(cls)]
        try:
            if why := why_no_regular_file(path):
                raise TrialError(f'{path} {why}')
            with np.load(path, allow_pickle=False) as file:
                missing = [name for name in names if name not in file.files]
                if missing:
                    raise TrialError(f'{path} is not a trial: it lacks {", ".join(missing)}')
                return cls(**{name: file[name] for name in names})
        except OSError as error:
            raise TrialError(f'{path} cannot be read: {error.strerror or "not an npz file"}') from None
        except (ValueError, EOFError, zipfile.BadZipFile, TypeError, AttributeError):
            # The last two: a single array, which is no context manager (AttributeError before Python 3.11).
            raise TrialError(f'{path} cannot be read: not an npz file, or cut short') from None
