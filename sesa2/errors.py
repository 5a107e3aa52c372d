"""The one root of everything that sesa2 raises on purpose."""


class Sesa2Error(Exception):
    """A failure whose message says what was got, what was expected and where; shown to the user without a traceback."""
