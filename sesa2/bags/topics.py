"""What a recording holds, and how topics of IMUs are called."""

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from rosbags.interfaces import Qos, QosDurability

from sesa2.messages.topic_names import is_called


class Message(NamedTuple):
    """A message as it was recorded: absolute name and type of its topic, when it was recorded, ns, its bytes in CDR."""

    topic: str
    type: str
    log_ns: int
    data: bytes


@dataclass(frozen=True)
class RecordedTopic:
    """Type and number of messages; latched: a late subscriber is given the last one; the type's text where known."""

    type: str
    count: int
    latched: bool = False
    definition: str = field(default='', compare=False, repr=False)


class Part(Protocol):
    """A recording or one file of it, open for reading.

    Attributes
    ----------
    topics
        by absolute name.
    problems
        what could not be read, for people; complete once all messages have been read.
    """

    topics: dict[str, RecordedTopic]
    problems: list[str]

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Messages of these topics, again from the start at each call."""

    def close(self) -> None:
        """Close the files."""


class ImuTopic(NamedTuple):
    """Where an IMU publishes; the namespace ends with a slash, and is empty where the name was given absolute."""

    namespace: str
    id: int


def imu_topic(name: str) -> ImuTopic | None:
    """Namespace and id of an IMU's topic that is called `…/imu_<id>/data`; None for any other name."""
    match = re.fullmatch(r'(/(?:.*/)?)imu_(\d+)/data', name)
    return ImuTopic(match[1], int(match[2])) if match else None


def named_imu_topic(name: str, given: Mapping[int, str]) -> ImuTopic | None:
    """The same where the names of topics are given by id; relative ones are looked for in any namespace."""
    for id_, wanted in given.items():
        if is_called(name, wanted):
            return ImuTopic(name.removesuffix(wanted), id_)
    return None


def field_topic(name: str) -> ImuTopic | None:
    """Namespace and id of the magnetometer beside an IMU, `…/imu_<id>/mag`; None for any other name."""
    match = re.fullmatch(r'(/(?:.*/)?)imu_(\d+)/mag', name)
    return ImuTopic(match[1], int(match[2])) if match else None


def magnetometer_topic(name: str) -> ImuTopic | None:
    """Namespace and id of a magnetometer in the arm, `…/magnetometer_<id>/field`; None for any other name."""
    match = re.fullmatch(r'(/(?:.*/)?)magnetometer_(\d+)/field', name)
    return ImuTopic(match[1], int(match[2])) if match else None


def is_latched(profiles: Iterable[Qos]) -> bool:
    """Whether a publisher of these profiles gives its last message to late subscribers."""
    return any(qos.durability is QosDurability.TRANSIENT_LOCAL for qos in profiles)
