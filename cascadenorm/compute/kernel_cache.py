"""Cache of compiled kernels on disk.

It uses internal classes of numba, which may change in any release; `kernels` then works without the cache.
"""

import os
import pickle
import shutil
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from hashlib import sha256
from pickle import UnpicklingError
from typing import Any, NamedTuple

from llvmlite.binding import ModuleRef, add_symbol, parse_assembly, parse_bitcode
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.runtime._nrt_python import c_helpers

from cascadenorm.compute import shipped_kernels
from cascadenorm.compute.shipped_kernels import kernel_digest, shipped_file


@cache
def _link_runtime() -> None:
    """Register the C functions of numba's runtime, which cached machine code calls by name."""
    for name, address in c_helpers.items():
        add_symbol(name if name.startswith("_") else f"NRT_{name}", address)


@cache
def _empty_bitcode() -> bytes:
    return bytes(parse_assembly("").as_bitcode())


def _readable(place: type[Any]) -> type[Any]:
    """Return a numba cache locator for a folder that exists but need not be writable."""

    class Readable(place):  # type: ignore[misc]
        def ensure_cache_path(self) -> None:
            if not os.path.isdir(self.get_cache_path()):
                raise OSError("there is no such folder")

    return Readable


class Bitcode(NamedTuple):
    """Bitcode of a cached kernel, parsed only when numba compiles a function that calls the kernel."""

    content: bytes

    def clone(self) -> ModuleRef:
        """Return the module to link."""
        return parse_bitcode(self.content)


class KernelPlaces(CompileResultCacheImpl):  # type: ignore[misc]
    """Folder for kernels: the first writable one, or a readable one if none is writable, as in a container."""

    _locator_classes = (
        *CompileResultCacheImpl._locator_classes,
        *map(_readable, CompileResultCacheImpl._locator_classes),
    )

    def reduce(self, compiled: Any) -> Any:
        """Leave out environments without constants: loading one would only import its module."""
        *content, environments = super().reduce(compiled)
        return (*content, tuple(one for one in environments if one.consts))

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Load the machine code of a kernel. numba would also parse its bitcode, which takes longer."""
        (name, kind, (code, bitcode)), function, *others = payload
        target_context.codegen()._engine._defined_symbols.add(function.llvm_cpython_wrapper_name)
        loaded = super().rebuild(target_context, ((name, kind, (code, _empty_bitcode())), function, *others))
        loaded.library._shared_module = Bitcode(bitcode)
        return loaded


class KernelCache(FunctionCache):  # type: ignore[misc]
    """Compiled overloads of a function on disk: those shipped with the package, then those compiled locally.

    The folder is searched for when the kernel is first called. Errors are ignored: if the disk is full or fails, or
    numba is incompatible, nothing is cached.
    """

    _impl_class = KernelPlaces

    def __init__(self, function: Callable[..., Any]) -> None:
        self._py_func = function

    def _open(self) -> None:
        """Search for the folder."""
        super().__init__(self._py_func)
        digest = partial(kernel_digest, self._py_func.__module__)
        self._cache_file = KernelFiles(self._cache_path, self._impl.filename_base, digest)

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return the compiled overload for a signature, or None.

        It needs the C functions of numba's runtime (NRT), but not the definitions that numba compiles from, which are
        slow to load.
        """
        with suppress(Exception):
            _link_runtime()
            if not hasattr(self, "_cache_file"):
                self._open()
            shipped = self._shipped(signature, context)
            return self._load_overload(signature, context) if shipped is None else shipped

    def save_overload(self, *arguments: Any) -> None:
        """Store the compiled overload for a signature."""
        with suppress(Exception):
            super().save_overload(*arguments)

    def _shipped(self, signature: Any, context: Any) -> Any:
        if not shipped_kernels.KERNELS_FOLDER.is_dir():
            return None
        path = shipped_file(self._py_func, signature, context.codegen().magic_tuple())
        with suppress(Exception):  # the file is missing or damaged
            return path and self._impl.rebuild(context, pickle.loads(path.read_bytes()))

    def ship(self) -> None:
        """Copy the locally compiled overloads to the folder of shipped kernels."""
        self._open()
        for (signature, target, _), name in self._cache_file._load_index().items():
            path = shipped_file(self._py_func, signature, target)
            assert path is not None, f"kernels are not shipped for {target}"
            path.parent.mkdir(exist_ok=True)
            shutil.copy(self._cache_file._data_path(name), path)


class KernelFiles(IndexDataCacheFile):  # type: ignore[misc]
    """Cache files that are safe for concurrent processes and valid for one version of the kernel sources.

    numba numbers the overloads of a function. Two processes that compile different overloads at the same time may use
    the same number, so that the next process would run the wrong one. Here each key has its own file name, and the
    file is written before the index refers to it; at worst the index loses an entry.

    numba considers a kernel unchanged as long as its own source file is unchanged, even if the kernels that it calls
    have changed. Here a digest of all their sources decides. It is computed when a kernel is first called, because
    modules are still incomplete when the kernel is defined.
    """

    def __init__(self, cache_path: str, filename_base: str, digest: Callable[[], object]) -> None:
        super().__init__(cache_path, filename_base, source_stamp=None)
        self._digest_of_sources = digest

    def save(self, key: Any, data: Any) -> None:
        """Store compiled data under a key."""
        self._source_stamp = self._digest_of_sources()
        digest = sha256(repr((self._source_stamp, key)).encode()).hexdigest()[:16]
        name = f"{self._index_name.removesuffix('.nbi')}.{digest}.nbc"
        self._save_data(name, data)
        self._save_index({**self._load_index(), key: name})

    def _load_index(self) -> dict[Any, str]:
        """Read the index; an unreadable index, such as one from another version, counts as empty."""
        self._source_stamp = self._digest_of_sources()
        try:
            return dict(super()._load_index())
        except (ImportError, AttributeError, ValueError, TypeError, EOFError, UnpicklingError):
            return {}
