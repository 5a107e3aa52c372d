"""The formats that are read: recognised by what is in a file, not by its name.

A further one is a module with `KIND`, `matches` and `read`, and a line here.
"""

from pathlib import Path
from typing import Protocol

import numpy as np

from sesa2.errors import shown
from sesa2.mocap import (
    c3d_file,
    euroc_csv,
    motive_csv,
    named_columns,
    qualisys_tsv,
    trc_file,
    tum_file,
    vicon_csv,
)
from sesa2.mocap.capture import MocapError, MotionCapture
from sesa2.mocap.export_file import ExportFile


class MocapReader(Protocol):
    """A module that reads one format."""

    KIND: str

    def matches(self, file: ExportFile) -> bool:
        """Whether a file is of this format."""

    def read(self, file: ExportFile) -> MotionCapture:
        """Read such a file."""


# The plain CSV is last: it takes whatever names a column of time.
READERS: tuple[MocapReader, ...] = (
    c3d_file, motive_csv, qualisys_tsv, trc_file, vicon_csv, euroc_csv, tum_file, named_columns,
)  # fmt: skip


def read_motion_capture(path: str | Path, rate: float | None = None) -> MotionCapture:
    """Read what a motion capture system exported.

    Parameters
    ----------
    path
        of the file.
    rate
        of its frames, Hz, where it counts them and does not say how fast.

    Raises
    ------
    MocapError
        the file is of no format that is known, or not whole.
    """
    file = ExportFile.load(path)
    for reader in READERS:
        if reader.matches(file):
            capture = reader.read(file) if reader is not named_columns else named_columns.read(file, rate)
            for body in capture.bodies.values():
                if not np.isfinite(body.times).all():
                    sample = int(np.argmin(np.isfinite(body.times)))
                    raise MocapError(f'{file.name}: sample {sample + 1} has no time')
            return capture
    kinds = ', '.join(reader.KIND for reader in READERS[:-1])
    first = file.head[0][:60]
    raise MocapError(
        f'{file.name}: no bag, and no known export ({kinds}); it begins with {shown(first)}. {named_columns.EXPECTED}'
    )
