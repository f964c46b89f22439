"""The registry of methods, and the declarations of their parameters and of the controls."""

from cascadenorm.errors import ParameterError
from cascadenorm.registry.methods import FAMILIES, REGION, Method, by_family, find, method, registered
from cascadenorm.registry.parameters import Parameter, Setting, checked_names, checked_number

__all__ = [
    "FAMILIES", "REGION", "Method", "Parameter", "ParameterError", "Setting", "by_family", "checked_names",
    "checked_number", "find", "method", "registered",
]  # fmt: skip
