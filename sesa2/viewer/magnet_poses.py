"""Where magnets and magnetometers are along a backbone that was heard, and a colour for how each magnetometer does."""

from dataclasses import replace

import numpy as np

from sesa2.configuration import Configuration
from sesa2.messages.colours import Colour
from sesa2.shape.reading_faults import ReadingFault
from sesa2.shape.rotations import FloatArray, from_rotation_vector, multiply, rotate, slerp
from sesa2.viewer.live import Diagnostic

WELL: Colour = (25, 175, 60)
DOUBTFUL: Colour = (240, 140, 0)
WRONG: Colour = (215, 25, 30)
UNUSED: Colour = (150, 150, 150)

_OF_FAULT: dict[ReadingFault, Colour] = {
    ReadingFault.SILENT: UNUSED,
    ReadingFault.SATURATED: WRONG,
    ReadingFault.REPEATING: WRONG,
    ReadingFault.JUMPING: DOUBTFUL,
    ReadingFault.DOUBTED: DOUBTFUL,
}
_OF_LEVEL: dict[int, Colour] = {0: WELL, 1: DOUBTFUL}


def poses_along(backbone: FloatArray, link_ends: FloatArray, s: FloatArray) -> FloatArray:
    """Poses of cross-sections.

    Parameters
    ----------
    backbone : (n, 7)
        poses at the ends of the links, m and x y z w, as `<model>/shape` has them: with the orientation of the middle
        of the link that ends there, but for the first, which has that of the link that begins, and the tip's own.
    link_ends : (n,)
        arc lengths of these ends at rest, m.
    s : (k,)
        arc lengths at rest, m.

    Returns
    -------
    (k, 7), m and x y z w.
    """
    positions = np.stack([np.interp(s, link_ends, backbone[:, k]) for k in range(3)], axis=-1)
    oriented_at = np.concatenate([link_ends[:1], 0.5 * (link_ends[:-2] + link_ends[1:-1]), link_ends[-1:]])
    place = np.interp(s, oriented_at, np.arange(len(oriented_at)))
    before = np.minimum(place.astype(int), len(oriented_at) - 2)
    return np.hstack([positions, slerp(backbone[before, 3:], backbone[before + 1, 3:], place - before)])


class MagnetPoses:
    """Poses of one arm's magnets and magnetometers.

    Parameters
    ----------
    c
        the arm; those that are masked have a place, too.
    link_ends : (n,)
        arc lengths at rest of the ends of the links that stand for it, m.
    """

    def __init__(self, c: Configuration, link_ends: FloatArray):
        segment_ends = c.layout.segment_ends
        self._ends = link_ends
        self._magnets = c.magnets.places(segment_ends).positions
        m = replace(c.magnetometers, masked=()).places(segment_ends)
        self._magnetometers, n = m.positions, len(m.ids)
        turn = from_rotation_vector(np.stack([np.zeros(n), np.zeros(n), m.azimuths], axis=-1))
        lever = np.stack([m.radii, np.zeros(n), m.axial_offsets], axis=-1)
        self._lever, self._mounting = rotate(turn, lever), multiply(turn, m.mountings)

    def magnets(self, backbone: FloatArray) -> FloatArray:
        """Centres and orientations, z towards the tip, (n_magnets, 7), of a backbone as `poses_along` takes it."""
        return poses_along(backbone, self._ends, self._magnets)

    def magnetometers(self, backbone: FloatArray) -> FloatArray:
        """Places and orientations of their own axes, (n_magnetometers, 7), in the order of the ids."""
        at = poses_along(backbone, self._ends, self._magnetometers)
        positions = at[:, :3] + rotate(at[:, 3:], self._lever)
        return np.hstack([positions, multiply(at[:, 3:], self._mounting)])


def magnetometer_colour(said: Diagnostic | None, masked: bool = False) -> Colour:
    """Green: it is used; orange: jumping or doubted; red: saturated or stuck; grey: masked, or nothing is heard of it.

    Parameters
    ----------
    said
        by the estimator of this magnetometer; None: nothing.
    masked
        whether it is configured not to be used.
    """
    if masked or said is None:
        return UNUSED
    found = {
        fault: int(n)
        for fault in _OF_FAULT
        if (n := said.values.get(f'sweeps {fault.name.lower()}', '')).isdigit()
    }
    if found:
        return _OF_FAULT[max(found, key=found.__getitem__)]
    if said.values.get('rate_hz') == '0.0' and said.level < 2:
        return UNUSED
    return _OF_LEVEL.get(said.level, WRONG)
