"""The error that makes callers draw another shape."""


class UnfitShapeError(ValueError):
    """A random shape that is empty, not manifold, or otherwise invalid. Callers draw another one."""
