"""What a simulation says of the true arm, as bytes: tip, markers, shape and coordinates."""

from collections.abc import Sequence

import numpy as np

from sesa2.configuration import Configuration
from sesa2.messages.cdr import CdrLayout
from sesa2.messages.results import TYPES, path_layout
from sesa2.messages.topic_names import TRUTH_COORDINATES, TRUTH_MARKERS, TRUTH_SHAPE, TRUTH_TIP
from sesa2.shape.rotations import FloatArray

TRUTH_TYPES = {
    TRUTH_TIP: TYPES['tip'],
    TRUTH_MARKERS: TYPES['markers'],
    TRUTH_SHAPE: TYPES['shape'],
    TRUTH_COORDINATES: TYPES['joint_states'],
}


class TruthMessages:
    """Makes the messages of the topics `truth/…`, in the frame of the results.

    Parameters
    ----------
    configuration
        frame and markers.
    n_places
        number of places of the shape, clamp and tip among them.
    coordinates
        names of the coordinates.
    """

    def __init__(self, configuration: Configuration, n_places: int, coordinates: Sequence[str]):
        frame, markers, n = configuration.frame_id, len(configuration.markers.names), len(coordinates)
        layouts = {
            TRUTH_TIP: CdrLayout().header(frame).doubles(7),
            TRUTH_MARKERS: CdrLayout().header(frame).uint32(markers).doubles(7 * markers),
            TRUTH_SHAPE: path_layout(frame, n_places),
            TRUTH_COORDINATES: CdrLayout()
            .header('')
            .strings(coordinates)
            .uint32(n)
            .doubles(n)
            .uint32(0)
            .uint32(0),
        }
        self._templates = {topic: layout.template() for topic, layout in layouts.items()}

    def make_truth(self, topic: str, stamps_ns: np.ndarray, values: FloatArray) -> list[bytes]:
        """Messages of one topic.

        Parameters
        ----------
        topic
            of TRUTH_TYPES.
        stamps_ns : (n,)
            ns, int64.
        values : (n, …)
            a row per message: poses (…, 7) of position, m, and orientation, x y z w; or coordinates.
        """
        rows = self._templates[topic].make(stamps_ns, values.reshape(len(stamps_ns), -1))
        return [row.tobytes() for row in rows]
