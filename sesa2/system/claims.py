"""Who publishes what on the graph: of two runs that would publish the same topics, the one that began later ends."""

import os
import re
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import rclpy
from rclpy.topic_endpoint_info import TopicEndpointInfo
from std_msgs.msg import Empty

from sesa2.configuration import Configuration
from sesa2.errors import Sesa2Error
from sesa2.messages.results import TYPES
from sesa2.messages.topic_names import BACKBONE_LENGTHS, CLOCK, imu_topics, magnetometer_field, of_model
from sesa2.messages.truth_messages import TRUTH_TYPES
from sesa2.system.machine_locks import MachineLocks

# Others on this machine are known by then, as a rule; who is not is found while running.
_DISCOVERY_S = 0.5
_LOOK_EVERY_S = 1.0
# What is unique to a process on the graph: its participant, the first bytes of each of its endpoints' ids.
_PARTICIPANT_BYTES = 12
_PAGE = '_run/page'
_SIGN = re.compile(r'.*/_run/began_(\d+)_on_([0-9a-f]+)_as_(\d+)')
_NO_NAME = '_NODE_NAME_UNKNOWN_'  # of a node of which only an endpoint has been heard


class ClaimError(Sesa2Error):
    """Somebody else publishes what this run would."""


class _Run(NamedTuple):
    """A `sesa2 run`: when it began, ns, and where: which machine (and which set of its processes), which process."""

    began_ns: int
    machine: str
    process: int

    @property
    def killed(self) -> bool:
        """Whether it is known to be gone; the graph remembers one that was killed for another 20 s."""
        return self.machine == _machine() and not Path(f'/proc/{self.process}').exists()


class Claims:
    """The topics of this run, as others on the graph see them.

    A run shows when it began by the name of a hidden topic, so that both of two runs come to know which is the older.

    Parameters
    ----------
    namespace
        of the run.
    with_page
        whether it is steered from a page: no two of these may be in one namespace, whatever they publish.
    """

    def __init__(self, namespace: str, with_page: bool):
        self._node = rclpy.create_node(
            'run_claims',
            namespace=namespace,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._me = _Run(time.time_ns(), _machine(), os.getpid())
        self._sign = f'_run/began_{self._me.began_ns}_on_{self._me.machine}_as_{self._me.process}'
        self._standing = [_PAGE] if with_page else []
        self._locks = MachineLocks()
        for name in (self._sign, *self._standing):
            self._node.create_publisher(Empty, name, 1)
        self._known_at = time.monotonic() + _DISCOVERY_S
        self._look_at = 0.0

    def check(self, configuration: Configuration) -> None:
        """Look whether anybody publishes already what this configuration would; keep others here from doing so.

        Raises
        ------
        ClaimError
            somebody does; the message names the topic and the node.
        """
        names = claimed_topics(configuration)
        # The graph takes some seconds at times; on one machine none of a second run's samples may get in meanwhile.
        taken = self._locks.hold(map(self._node.resolve_topic_name, (*self._standing, *names)))
        if taken:
            who = 'another `sesa2 run` on this machine'
            raise self._rival(names, older=False) or ClaimError(_sentence(taken, who, taken == CLOCK))
        while not (rival := self._rival(names, older=False)) and time.monotonic() < self._known_at:
            time.sleep(0.02)
        if rival:
            raise rival

    def check_again(self, configuration: Configuration | None) -> None:
        """Look, once a second, whether anybody publishes what this run does; a younger run is to end by itself.

        Parameters
        ----------
        configuration
            of what runs; None where nothing does.

        Raises
        ------
        ClaimError
            somebody does.
        """
        if time.monotonic() < self._look_at:
            return
        self._look_at = time.monotonic() + _LOOK_EVERY_S
        if rival := self._rival(claimed_topics(configuration) if configuration else [], older=True):
            raise rival

    def close(self) -> None:
        """End the node."""
        self.release()
        self._node.destroy_node()

    def release(self) -> None:
        """Let others on this machine have the topics, since nothing runs any more."""
        self._locks.release()

    def _rival(self, names: Sequence[str], older: bool) -> ClaimError | None:
        """Somebody else who publishes one of these; of other runs only those that began earlier, if asked so."""
        me = self._participants(self._node.resolve_topic_name(self._sign))
        if not me:  # the graph does not know us yet
            return None
        runs = {
            participant: _Run(int(sign[1]), sign[2], int(sign[3]))
            for name, _ in self._node.get_topic_names_and_types()
            if (sign := _SIGN.fullmatch(name))
            for participant in self._participants(name)
        }
        for name in (*self._standing, *names):
            topic = self._node.resolve_topic_name(name)
            for info in self._node.get_publishers_info_by_topic(topic):
                participant = _participant(info)
                run = runs.get(participant)
                if participant in me or (run and (run.killed or (older and run > self._me))):
                    continue
                return ClaimError(_sentence(topic, _who(info, run is not None), name.startswith('/')))
        return None

    def _participants(self, topic: str) -> set[bytes]:
        return {_participant(info) for info in self._node.get_publishers_info_by_topic(topic)}


def claimed_topics(c: Configuration) -> list[str]:
    """What a run of this configuration publishes and nobody else may."""
    topics: list[str] = []
    if c.run.mode == 'stream':
        topics += [of_model(model, kind) for model in c.models for kind in TYPES]
    if c.run.source != 'external':
        topics += imu_topics(c).values()
        topics += map(magnetometer_field, c.magnetometers.ids)
    if c.has_field_source:
        topics += TRUTH_TYPES
    if c.has_plant:
        topics += [BACKBONE_LENGTHS, *TRUTH_TYPES]
    if c.run.source == 'bag' and c.has_lengths:
        topics.append(BACKBONE_LENGTHS)
    if c.run.source == 'bag' and c.run.clock:
        topics.append(CLOCK)
    return topics


def _participant(info: TopicEndpointInfo) -> bytes:
    return bytes(info.endpoint_gid[:_PARTICIPANT_BYTES])


def _machine() -> str:
    """The kernel as it was started, and the set of processes in it that know each other by number."""
    kernel = Path('/proc/sys/kernel/random/boot_id').read_text('ascii').strip().replace('-', '')[:12]
    return f'{kernel}{Path("/proc/self/ns/pid").stat().st_ino:x}'


def _who(info: TopicEndpointInfo, is_run: bool) -> str:
    node = f'the node {info.node_namespace.rstrip("/")}/{info.node_name}'
    who = 'a node' if info.node_name == _NO_NAME else node
    return f'{who} of {"another `sesa2 run`" if is_run else "another program"}'


def _sentence(topic: str, who: str, everywhere: bool) -> str:
    remedy = 'ROS_DOMAIN_ID' if everywhere else '--namespace or ROS_DOMAIN_ID'
    doing = 'is steered from a page here' if topic.endswith(_PAGE) else f'publishes {topic} already'
    return f'{who} {doing}: end it, or keep the two apart by {remedy}'
