"""What controls do around every method: weights, boundaries, creases, detail, sliding and displacement limits."""

from cascadenorm.errors import DenoiseError as DenoiseError
