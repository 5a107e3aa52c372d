"""The table of golden packets, firmware/test/golden_packets.txt, over which both sides of the link run."""

from configparser import ConfigParser, SectionProxy
from pathlib import Path

_TABLE = Path(__file__).parents[1] / 'firmware' / 'test' / 'golden_packets.txt'


def _read() -> ConfigParser:
    table = ConfigParser(interpolation=None, comment_prefixes=('#',))
    table.read(_TABLE, encoding='utf-8')
    return table


PACKETS = _read()


def names(*kinds: str) -> list[str]:
    """Names of the packets of some kinds."""
    return [name for name in PACKETS.sections() if PACKETS[name]['kind'] in kinds]


def number(packet: SectionProxy, key: str) -> int:
    """A field that is one number."""
    return int(packet[key], 0)


def numbers(packet: SectionProxy, key: str) -> list[int]:
    """A field that is several."""
    return [int(word, 0) for word in packet[key].split()]
