"""A recorded motion as one HTML file with a time line, which needs no network and no installation."""

from collections.abc import Mapping

import numpy as np

from sesa2.configuration import Configuration
from sesa2.errors import Sesa2Error
from sesa2.shape.rotations import FloatArray
from sesa2.viewer.live import Live
from sesa2.viewer.scene import Scene
from sesa2.viewer.server import open_server


def view_html(
    c: Configuration,
    times_s: FloatArray,
    backbones: Mapping[str, FloatArray],
    markers: Mapping[str, FloatArray] | None = None,
    truth_markers: FloatArray | None = None,
    frames_per_s: float = 20.0,
) -> str:
    """Make the page.

    Parameters
    ----------
    c
        the configuration in force, for the arm's radius, base and markers.
    times_s : (n,)
        when each shape was, s, ascending.
    backbones : each (n, k, 7)
        for each model, positions, m, and orientations x y z w, base to tip, as `<model>/shape` has them.
    markers : each (n, m, 7), optional
        for each model, as `<model>/markers` has them.
    truth_markers : (n, m, 7), optional
        drawn as ghosts.
    frames_per_s
        at most; what lies between is left out.

    Returns
    -------
    The HTML.

    Raises
    ------
    Sesa2Error
        nothing to show.
    """
    times = np.asarray(times_s, dtype=float)
    unknown = set(backbones) - set(c.models)
    if not len(times) or not backbones or unknown:
        got = f'models {", ".join(sorted(unknown))} that are not in it' if unknown else 'nothing'
        raise Sesa2Error(f'a film needs shapes of the models of the configuration, got {got}')
    kept = _thin_out(times, frames_per_s)
    server = open_server(port=0)
    try:
        scene = Scene(server, imus=False)
        scene.configure(c)
        live = Live(configuration=c)
        serializer = None
        for i, following in zip(kept, [*kept[1:], None], strict=True):
            live.backbones = {name: poses[i] for name, poses in backbones.items()}
            live.markers = {name: poses[i] for name, poses in (markers or {}).items()}
            live.truth_markers = None if truth_markers is None else truth_markers[i]
            scene.draw(live)
            serializer = serializer or server.get_scene_serializer()
            if following is not None:
                serializer.insert_sleep(float(times[following] - times[i]))
        assert serializer is not None
        return serializer.as_html()
    finally:
        server.stop()


def _thin_out(times: FloatArray, frames_per_s: float) -> list[int]:
    """Indices of the frames that are kept."""
    kept, due = [], -np.inf
    for i, t in enumerate(times):
        if t >= due:
            kept.append(i)
            # A little early, so that sampling at the very rate does not lose every other frame to rounding.
            due = t + 0.999 / frames_per_s
    return kept
