"""The registry of methods, and the declarations of their parameters and of the controls."""

from cascadenorm.errors import ParameterError
from cascadenorm.registry.methods import FAMILIES, REGION, Family, Method, by_family, find, method, registered
from cascadenorm.registry.parameters import Parameter, Setting, declared

__all__ = [
    "FAMILIES", "REGION", "Family", "Method", "Parameter", "ParameterError", "Setting", "by_family", "declared", "find",
    "method", "registered",
]  # fmt: skip
