"""What ROS takes as the name of a topic, a namespace or a frame."""

import re

_TOKEN = '[A-Za-z_][A-Za-z0-9_]*'
_TOPIC = re.compile(rf'/?{_TOKEN}(?:/{_TOKEN})*')
_PREFIX = re.compile(r'(?:[A-Za-z][A-Za-z0-9_/]*)?')


def is_topic_name(name: str) -> bool:
    """Whether a topic or a namespace may be called so, absolute or relative; `~` and substitutions may not be used."""
    return _TOPIC.fullmatch(name) is not None


def is_frame_prefix(text: str) -> bool:
    """Whether frames may begin with it; they may not begin with a slash."""
    return _PREFIX.fullmatch(text) is not None
