"""The one root of everything that sesa2 raises on purpose, and how its messages show what was got."""

import reprlib


class Sesa2Error(Exception):
    """A failure whose message says what was got, what was expected and where; shown to the user without a traceback."""


_BRIEF = reprlib.Repr()
_BRIEF.maxlevel = 3
_BRIEF.maxstring = _BRIEF.maxother = 60


def shown(value: object) -> str:
    """A value as messages show it: as Python writes it, shortened, however large, deep or recursive it is."""
    try:
        return shortened(_BRIEF.repr(value))
    except ValueError:  # Python writes no integer of more than some thousand digits
        return f'a very large {type(value).__name__}'


def shortened(text: str, longest: int = 120) -> str:
    """A text of at most so many characters, as Python would escape what cannot be printed."""
    text = text if len(text) <= longest else f'{text[: longest - 1]}…'
    return ''.join(c if c.isprintable() else repr(c)[1:-1] for c in text)
