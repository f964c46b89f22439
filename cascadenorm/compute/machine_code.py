"""Load compiled kernels from their machine code alone.

numba also parses the intermediate code that it stores beside the machine code, reads all symbols, and compiles its own
runtime in each process. Only the compilation of another kernel that calls the loaded one needs these.

It uses internal classes of numba, like `kernel_cache`.
"""

from functools import cache, cached_property
from typing import Any

from llvmlite import binding
from llvmlite.binding.object_file import ObjectFileRef
from numba import _dynfunc  # type: ignore[attr-defined]
from numba.core.compiler import compile_result
from numba.core.runtime import _nrt_python  # type: ignore[attr-defined]
from numba.core.runtime.nrt import rtsys


def loaded_kernel(context: Any, payload: tuple[Any, ...]) -> Any:
    """Return the compilation result for what numba stored of it.

    Parameters
    ----------
    context
        Target context of numba.
    payload
        Result of `CompileResult._reduce`.
    """
    stored, function, environment, signature, object_mode, lifted, annotation, reload_init, environments = payload
    name, _, (machine_code, _) = stored
    _register_runtime()
    codegen = context.codegen()
    codegen._engine._ee.add_object_file(ObjectFileRef.from_data(machine_code))
    codegen._engine.finalize_object()
    address = codegen._engine.get_function_address(function.llvm_cpython_wrapper_name)
    for one in (environment, *environments):
        codegen.set_env(one.env_name, one)
    return compile_result(  # type: ignore[no-untyped-call]
        typing_context=context.typing_context,
        target_context=context,
        entry_point=_dynfunc.make_function(function.lookup_module(), name, "compiled", address, environment, ()),
        type_annotation=annotation,
        signature=signature,
        objectmode=object_mode,
        lifted=lifted,
        fndesc=function,
        library=_StoredLibrary(context, stored),
        environment=environment,
        reload_init=reload_init,
        referenced_envs=environments,
    )


@cache
def _register_runtime() -> None:
    """Make the functions of numba's runtime known to LLVM, as `rtsys.initialize` does before it compiles others."""
    for name, address in _nrt_python.c_helpers.items():
        binding.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)


class _StoredLibrary:
    """A stored library of numba, which is read when another kernel is linked with it.

    Parameters
    ----------
    context
        Target context of numba.
    stored
        Result of the library's `serialize_using_object_code`.
    """

    def __init__(self, context: Any, stored: Any) -> None:
        self._context, self._stored = context, stored

    @cached_property
    def _library(self) -> Any:
        rtsys.initialize(self._context)
        return self._context.codegen().unserialize_library(self._stored)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._library, name)
