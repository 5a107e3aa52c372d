"""Where the tip was over the last seconds."""

import time
from collections import deque

import numpy as np
import viser
from viser import uplot

from sesa2.shape.rotations import FloatArray

_SPAN_S = 20.0
_PERIOD_S = 0.1
_AXES = (('x', '#e03131'), ('y', '#2f9e44'), ('z', '#1971c2'))


class TipPlot:
    """A plot of the tip's coordinates.

    Parameters
    ----------
    gui
        of the page; the plot goes where its context is.
    """

    def __init__(self, gui: viser.GuiApi):
        self._history: deque[tuple[float, ...]] = deque(maxlen=round(_SPAN_S / _PERIOD_S))
        empty = np.array([-_SPAN_S, 0.0])
        self._plot = gui.add_uplot(
            data=(empty, *(np.full(2, np.nan) for _ in _AXES)),
            series=(
                uplot.Series(label='s'),
                *(uplot.Series(label=f'{name} [m]', stroke=colour, width=1.5) for name, colour in _AXES),
            ),
            scales={
                'x': uplot.Scale(time=False, auto=False, range=(-_SPAN_S, 0.0)),
                'y': uplot.Scale(auto=True),
            },
            height=170,
            padding=(8, 12, 0, 0),
        )

    def add(self, position: FloatArray) -> None:
        """Take a tip position, (3,), m; too many are thinned out."""
        now = time.monotonic()
        if not self._history or now - self._history[-1][0] >= _PERIOD_S:
            self._history.append((now, *position))

    def clear(self) -> None:
        """Begin anew."""
        self._history.clear()

    def draw(self) -> None:
        """Show the last seconds."""
        if len(self._history) > 1:
            table = np.array(self._history).T
            table[0] -= time.monotonic()
            self._plot.data = tuple(np.ascontiguousarray(row) for row in table)
