"""Machine code from Python: Numba compiles a function, LLVM makes it an object file, and a linker makes that a library.

Without a linker the object file itself is kept, and LLVM links it when it is loaded: nothing has to be compiled again,
but the process then holds LLVM. The code is for a level of processors, see `compiled.library.level`.
"""

import gc
import inspect
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import llvmlite.binding as llvm
import numba
import numpy as np
from numba import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.extending import typeof_impl

from palpate.compiled.kernels import Kernel

if TYPE_CHECKING:
    from palpate.compiled import Compiled

llvm.initialize_native_target()
llvm.initialize_native_asmprinter()
# A loop over two rows of one array is vectorised if these do not overlap, and not if those of the loop about it do.
llvm.set_option("palpate", "-hoist-runtime-checks=false")
_OPTIONS: dict[str, Any] = {
    "error_model": "numpy"
}  # division by zero gives inf as in NumPy; a check would cost time in every loop
_KEPT: list[llvm.ExecutionEngine] = []  # with the code that was linked in memory
_KERNELS: dict[Kernel, Any] = {}  # with Numba's form of each
# Numba's handling of errors that are not caught, and of arrays that are made, neither of which there is here.
_NEVER_CALLED = """
declare void @abort()
define i32 @numba_gil_ensure() { call void @abort() unreachable }
define void @numba_gil_release(ptr %a) { ret void }
define ptr @numba_unpickle(ptr %a, i32 %b, ptr %c) { ret ptr null }
define ptr @numba_runtime_build_excinfo_struct(ptr %a, ptr %b) { ret ptr null }
define i32 @numba_do_raise(ptr %a) { ret i32 0 }
define void @NRT_Free(ptr %a) { ret void }
define void @NRT_MemInfo_call_dtor(ptr %a) { ret void }
"""


def library(compiled: "Compiled", level: str) -> tuple[bytes, str]:
    """Return the library of a function and the suffix of its file, or its object file where there is no linker."""
    made = object_file(compiled, level)
    compiler = shutil.which("cc")
    if compiler is None:
        return made, ".o"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "code.o")
        path.write_bytes(made)
        words = [compiler, "-shared", "-o", str(path.with_suffix(".so")), str(path), "-lm"]
        if subprocess.run(words, capture_output=True, check=False).returncode:
            return made, ".o"
        return path.with_suffix(".so").read_bytes(), ".so"


def object_file(compiled: "Compiled", level: str) -> bytes:
    """Return the machine code of a function, as an object file that needs nothing but the library of C."""
    with _no_search_for_garbage():
        text = _entry(compiled).inspect_llvm()
    module = llvm.parse_assembly(text)
    (entry,) = (function for function in module.functions if function.name.startswith("cfunc."))
    entry.name = compiled.name
    module.link_in(llvm.parse_assembly(_NEVER_CALLED))
    for function in module.functions:
        if not function.is_declaration and function.name != compiled.name:
            function.linkage = "internal"
    target = llvm.Target.from_triple(module.triple)
    machine = target.create_target_machine(cpu=level, opt=3, reloc="pic", codemodel="default")
    tuning = llvm.create_pipeline_tuning_options(speed_level=3)
    tuning.loop_vectorization = True
    tuning.slp_vectorization = True
    passes = llvm.create_pass_builder(machine, tuning)
    passes.getModulePassManager().run(module, passes)
    return machine.emit_object(module)


@contextmanager
def _no_search_for_garbage() -> Iterator[None]:
    """Keep Python from looking for garbage among the objects that Numba makes, which takes a sixth of its time."""
    is_usual = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if is_usual:
            gc.enable()


def linked_in_memory(code: bytes, name: str) -> int:
    """Return the address of a function of an object file, which LLVM links in memory."""
    machine = llvm.Target.from_default_triple().create_target_machine(opt=0)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _KEPT.append(engine)
    return engine.get_function_address(name)


def _entry(compiled: "Compiled") -> Any:
    """Return Numba's compiled function of C that takes the numbers of `palpate.compiled._flatten`."""
    parameters: list[str] = []
    kinds: list[Any] = []
    names = {
        "carray": numba.carray,  # pyright: ignore[reportPrivateImportUsage]
        "function": _jit(compiled.function, compiled.options),
    }
    taken = ", ".join(_expression(example, parameters, kinds, names) for example in compiled.example)
    returns_number = inspect.signature(compiled.function).return_annotation is int
    text = f"""
def entry({", ".join(parameters)}):
    try:
        {"return " if returns_number else ""}function({taken})
    except Exception:
        return -1
    return 0
"""
    exec(text, names)
    return numba.cfunc(types.int64(*kinds), pipeline_class=_KernelCompiler, **_OPTIONS)(names["entry"])


def _expression(example: Any, parameters: list[str], kinds: list[Any], names: dict[str, Any]) -> str:
    """Return the expression of an argument from numbers, and append what they are."""

    def parameter(kind: Any) -> str:
        parameters.append(f"p{len(parameters)}")
        kinds.append(kind)
        return parameters[-1]

    def constant(value: Any) -> str:
        name = f"c{len(names)}"
        names[name] = value
        return name

    if isinstance(example, np.ndarray):
        address = parameter(types.voidptr)
        lengths = [parameter(types.int64) for _ in example.shape]
        return f"carray({address}, ({', '.join(lengths)},), {constant(example.dtype)})"
    if isinstance(example, tuple):
        parts = [_expression(part, parameters, kinds, names) for part in example]
        make = constant(type(example)) if hasattr(example, "_fields") else ""
        return f"{make}({', '.join(parts)}{'' if make else ','})"
    if isinstance(example, complex):
        return f"complex({parameter(types.float64)}, {parameter(types.float64)})"
    return parameter(types.float64 if isinstance(example, float) else types.int64)


def _jit(function: Any, options: dict[str, Any]) -> Any:
    """Return Numba's form of a function that only compiled ones call, and that makes no arrays."""
    only_called = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "_nrt": False}
    return numba.njit(function, pipeline_class=_KernelCompiler, **only_called, **_OPTIONS, **options)


@typeof_impl.register(Kernel)
def _type_of_kernel(kernel: Kernel, _: Any) -> types.Dispatcher:
    """Return the type by which Numba knows a kernel."""
    if kernel not in _KERNELS:
        _KERNELS[kernel] = _jit(kernel.function, kernel.options)
    return types.Dispatcher(_KERNELS[kernel])


class _KernelLibrary(JITCodeLibrary):
    """Code of a kernel, which is neither optimised nor made machine code before it is part of a caller."""

    @property
    def codegen(self) -> Any:
        """Itself, as it has no place in the engine: Numba asks that for the next only."""
        return self

    def set_env(self, *_: object) -> None:
        """Keep no objects: kernels use none."""

    def finalize(self) -> None:
        """Add what the kernel calls."""
        for library in dict.fromkeys(self._linking_libraries):
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return no address, as nothing is loaded here."""
        self._ensure_finalized()
        return 0


class _KernelCompiler(Compiler):
    def __init__(self, typing: Any, target: Any, _library: None, *given: Any) -> None:
        super().__init__(typing, target, _KernelLibrary(target.codegen(), "kernel"), *given)
