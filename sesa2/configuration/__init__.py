"""The configuration: what it holds, how it is validated, and its file."""

from sesa2.configuration.records import Configuration
from sesa2.configuration.validation import ConfigurationError, Mistake, validate

__all__ = ['Configuration', 'ConfigurationError', 'Mistake', 'validate']
