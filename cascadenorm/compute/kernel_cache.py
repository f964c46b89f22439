"""Compiled kernels on disk, through classes of numba that may change with any release; `kernels` then does without."""

import os
import pickle
import shutil
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from hashlib import sha256
from pickle import UnpicklingError
from typing import Any

from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.runtime.nrt import rtsys

from cascadenorm.compute.shipped_kernels import kernel_digest, shipped_file


def _readable(place: type[Any]) -> type[Any]:
    """Return a place of numba's that need only exist, where numba asks that it can be written."""

    class Readable(place):  # type: ignore[misc]
        def ensure_cache_path(self) -> None:
            if not os.path.isdir(self.get_cache_path()):
                raise OSError("there is no such folder")

    return Readable


class KernelPlaces(CompileResultCacheImpl):  # type: ignore[misc]
    """Where kernels are kept: the first place that can be written; if none can, as in a container, one to read from."""

    _locator_classes = (
        *CompileResultCacheImpl._locator_classes,
        *map(_readable, CompileResultCacheImpl._locator_classes),
    )


class KernelCache(FunctionCache):  # type: ignore[misc]
    """The compiled forms of a function on disk: those that came with the package, then those compiled here.

    A disk that is full or fails keeps none, and so does another numba.
    """

    _impl_class = KernelPlaces

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        digest = partial(kernel_digest, function.__module__)
        self._cache_file = KernelFiles(self._cache_path, self._impl.filename_base, digest)

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return the compiled form for a signature, or None.

        It needs the memory management of numba, but not what numba compiles from, which takes 0.25 s to load.
        """
        with suppress(Exception):
            rtsys.initialize(context)
            shipped = self._shipped(signature, context)
            return self._load_overload(signature, context) if shipped is None else shipped

    def save_overload(self, *arguments: Any) -> None:
        """Keep the compiled form for a signature."""
        with suppress(Exception):
            super().save_overload(*arguments)

    def _shipped(self, signature: Any, context: Any) -> Any:
        path = shipped_file(self._py_func, signature, context.codegen().magic_tuple())
        with suppress(Exception):  # of a file that is absent, or that a disk has damaged
            return path and self._impl.rebuild(context, pickle.loads(path.read_bytes()))

    def ship(self) -> None:
        """Copy the forms that were compiled here to those that come with the package."""
        for (signature, target, _), name in self._cache_file._load_index().items():
            path = shipped_file(self._py_func, signature, target)
            assert path is not None, f"kernels are not shipped for {target}"
            path.parent.mkdir(exist_ok=True)
            shutil.copy(self._cache_file._data_path(name), path)


class KernelFiles(IndexDataCacheFile):  # type: ignore[misc]
    """Files that several processes may write at once, valid for one source of a kernel and of those that it calls.

    numba numbers the compiled forms of a function. Two processes that compile it at once for different types may take
    the same number, and the next process runs for one type what was compiled for the other. Here a file has a name of
    its own for each key, and is there before the index names it; at worst the index forgets one.

    numba takes a kernel for unchanged as long as the file that holds it is, whatever becomes of the kernels that it
    calls. Here a digest of all their sources decides. It is asked for when a kernel is first called, since modules are
    not yet complete when the kernel is defined.

    Parameters
    ----------
    cache_path
        Folder of the files.
    filename_base
        What their names begin with.
    digest
        Returns what tells one source from another.
    """

    def __init__(self, cache_path: str, filename_base: str, digest: Callable[[], object]) -> None:
        super().__init__(cache_path, filename_base, source_stamp=None)
        self._digest_of_sources = digest

    def save(self, key: Any, data: Any) -> None:
        """Keep compiled data under a key."""
        self._source_stamp = self._digest_of_sources()
        digest = sha256(repr((self._source_stamp, key)).encode()).hexdigest()[:16]
        name = f"{self._index_name.removesuffix('.nbi')}.{digest}.nbc"
        self._save_data(name, data)
        self._save_index({**self._load_index(), key: name})

    def _load_index(self) -> dict[Any, str]:
        """Read the index; one that another version has left, and this one cannot read, counts as empty."""
        self._source_stamp = self._digest_of_sources()
        try:
            return dict(super()._load_index())
        except (ImportError, AttributeError, ValueError, TypeError, EOFError, UnpicklingError):
            return {}
