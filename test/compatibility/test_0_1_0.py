"""What version 0.1.0 wrote is read as before: its own configuration, calibration file and bag, kept here."""

from pathlib import Path

import numpy as np
import pytest

import sesa2
from sesa2.bags.reading import read_configuration
from sesa2.bags.recording import open_recording
from sesa2.configuration import files
from sesa2.messages.poses import read_path, read_pose_array
from sesa2.sensing.imu.bno055.offsets import Offsets, load_offsets

WRITTEN = Path(__file__).parent / 'from_0_1_0'
MODELS = ('rigid', 'pcc', 'pcc_exact', 'spline')


def test_its_configuration():
    c = sesa2.load_configuration(WRITTEN / 'configuration.yaml')
    assert c.models == MODELS
    assert c.links == 4
    assert c.options['pcc'].segments == (2,) * 8
    assert c.options['rigid'].boundaries == 'endpoint'
    assert c.headings[2] == -0.251675971
    np.testing.assert_allclose(
        c.mountings[0], [3.0753e-05, 0.007468511, -0.006853329, 0.999948625], atol=1e-9
    )
    assert c.markers.names == ('M1', 'M2')
    # Nothing of it is lost or changed by writing it anew.
    assert files.parse(files.dump(c), 'dump') == c


def test_its_calibration_file():
    saved = load_offsets(WRITTEN / 'offsets.yaml', range(1, 9))
    assert saved.missing == (3, 4, 5, 6, 7)
    assert saved.offsets[8] == Offsets((1247, 838, -2748), (1450, -159, -2452), (-1534, 246, 1360), 46, 677)


def results(path):
    """Markers and backbone of every model, by topic and stamp."""
    wanted = {f'/{model}/{kind}' for model in MODELS for kind in ('markers', 'shape')}
    found = {}
    with open_recording(path) as recording:
        assert wanted <= set(recording.topics)
        for message in recording.messages(wanted):
            read = read_path if message.topic.endswith('shape') else read_pose_array
            poses = read(message.data)
            found[message.topic, poses.stamp_ns] = poses.poses
        assert not recording.problems
    return found


@pytest.mark.parametrize('given', ['the file', 'the bag'])
def test_its_bag_replays_to_what_it_published(tmp_path, given):
    text = read_configuration(WRITTEN / 'bag')
    c = (
        files.parse(text, 'bag')
        if given == 'the bag'
        else sesa2.load_configuration(WRITTEN / 'configuration.yaml')
    )
    sesa2.replay(WRITTEN / 'bag', c, tmp_path / 'out')
    before, now = results(WRITTEN / 'bag'), results(tmp_path / 'out')
    common = set(before) & set(now)
    # A live run may have begun in the middle of a sweep, and ended in one.
    assert len(common) > len(before) - 8 * 10 > 3000
    for key in common:
        # The spline did not keep the arm's length then: on this arm its tip is off by less than 0.1 mm.
        atol = 1e-4 if key[0].startswith('/spline/') else 1e-9
        np.testing.assert_allclose(now[key][:, :3], before[key][:, :3], rtol=0.0, atol=atol)
        # q and −q are the same.
        cosines = np.abs(np.einsum('ni,ni->n', now[key][:, 3:], before[key][:, 3:]))
        np.testing.assert_allclose(cosines, 1.0, atol=1e-9)


def test_its_bag_is_evaluated(tmp_path):
    evaluation = sesa2.evaluate(
        WRITTEN / 'bag', WRITTEN / 'bag', truth_topic='/spline/markers', models=['pcc', 'spline']
    )
    assert (
        evaluation.models['spline']['M2'].median_mm < 1e-6 < evaluation.models['pcc']['M2'].median_mm < 10.0
    )
