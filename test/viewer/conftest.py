"""The browser, for the tests of this folder."""

from browsing import browser, tab  # noqa: F401
