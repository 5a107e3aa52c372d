"""What was measured, whatever it was measured with: what every shape model takes."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sesa2.shape.arm import GeometryError
from sesa2.shape.layout import Layout
from sesa2.shape.rotations import IDENTITY, FloatArray


class Measured(NamedTuple):
    """One instant, or a batch of them, of everything that was measured; a kind that is absent is None.

    A further kind of sensor is a further field here, its places in `Layout`, and a check of its shape in `check`.

    Attributes
    ----------
    orientations : batch + (n_imu, 4)
        q_WL at the IMUs, x y z w, unit norm, any signs.
    base : (4,)
        or batch + (4,), q_WB, x y z w: known or measured.
    lengths : batch + (n_segments,)
        present length of each segment on the axis of the arm, base to tip, m.
    backbone_bends : batch + (n_segments, 2)
        bend_x, bend_y of each segment by the lengths of its backbones, rad; NaN where they do not tell.
    fields : batch + (n_magnetometers, 3)
        magnetic field in the magnetometers' own axes, T; NaN on axes that are not there, and where none was measured.
    times : batch
        when it was measured, s, ascending; for models that remember.
    """

    orientations: ArrayLike | None = None
    base: ArrayLike = IDENTITY
    lengths: ArrayLike | None = None
    backbone_bends: ArrayLike | None = None
    fields: ArrayLike | None = None
    times: ArrayLike | None = None

    def check(self, model: str, needs: tuple[str, ...], layout: Layout) -> None:
        """Refuse what a model cannot work with.

        Parameters
        ----------
        model
            its name, for the message.
        needs
            names of the kinds that it needs.
        layout
            where they were measured.

        Raises
        ------
        GeometryError
            a kind is absent, or not of the layout's shape.
        """
        for kind in needs:
            if getattr(self, kind) is None:
                raise GeometryError(f'model {model!r} needs {kind}, and there are none in what was measured')
        if self.orientations is not None and np.shape(self.orientations)[-2:] != (layout.n_imu, 4):
            raise GeometryError(
                f'orientations of shape {np.shape(self.orientations)}, expected (..., {layout.n_imu}, 4)'
            )
        if self.fields is not None and np.shape(self.fields)[-2:] != (layout.n_magnetometers, 3):
            raise GeometryError(
                f'fields of shape {np.shape(self.fields)}, expected (..., {layout.n_magnetometers}, 3)'
            )
        if self.lengths is not None:
            lengths, n = np.asarray(self.lengths, dtype=float), len(layout.segment_lengths)
            if lengths.shape[-1:] != (n,):
                raise GeometryError(f'lengths of shape {lengths.shape}, expected (..., {n}): one per segment')
            wrong = ~(np.isfinite(lengths) & (lengths > 0.0))
            if wrong.any():
                raise GeometryError(f'lengths: got {lengths[wrong][0]} m, expected a positive number')

    @property
    def stations(self) -> FloatArray:
        """Orientations of the base and of the IMUs, batch + (n_imu + 1, 4), x y z w."""
        return with_base(np.asarray(self.orientations, dtype=float), np.asarray(self.base, dtype=float))


def with_base(orientations: FloatArray, base: FloatArray) -> FloatArray:
    """Put the base's orientation before those along the arm.

    Parameters
    ----------
    orientations : batch + (n, 4)
        x y z w.
    base : (4,)
        or batch + (4,), x y z w.

    Returns
    -------
    batch + (n + 1, 4), x y z w.
    """
    *batch, n, _ = orientations.shape
    stations = np.empty((*batch, n + 1, 4))
    stations[..., 0, :] = base
    stations[..., 1:, :] = orientations
    return stations
