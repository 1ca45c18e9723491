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
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import llvmlite.binding as llvm
import numba
from llvmlite import ir
from numba import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.extending import intrinsic, typeof_impl
from numba.np.arrayobj import np_cfarray

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
    """Return Numba's compiled function of C that takes the packed numbers of `palpate.compiled.Compiled`."""
    arguments = _unpacking(compiled.example)
    function = _jit(compiled.function, compiled.options, _KernelCompiler)

    def call(packed: Any) -> Any:
        try:
            function(*arguments(packed))
        except Exception:
            return -1
        return 0

    def call_for_number(packed: Any) -> Any:
        try:
            return function(*arguments(packed))
        except Exception:
            return -1

    returns_number = inspect.signature(compiled.function).return_annotation is int
    entry = call_for_number if returns_number else call
    return numba.cfunc(types.int64(types.voidptr), pipeline_class=_KernelCompiler, **_OPTIONS)(entry)


def _unpacking(example: tuple[Any, ...]) -> Any:
    """Return the function for compiled code that makes arguments like those of an example from packed numbers.

    It is written for LLVM, as the same in Python compiles for as long as a fifth of the solver.
    """
    kind: Any = numba.typeof(example)

    @intrinsic
    def arguments(_: Any, __: Any) -> Any:
        def code(context: Any, builder: Any, _: Any, packed: Any) -> Any:
            word = ir.IntType(64)
            first = builder.bitcast(packed[0], word.as_pointer())
            places = (builder.gep(first, [word(number)]) for number in count())
            return _value(context, builder, kind, map(builder.load, places))

        return kind(types.voidptr), code

    return arguments


def _value(context: Any, builder: Any, kind: Any, words: Iterator[Any]) -> Any:
    """Return the value of a type, of which it takes the next words."""
    if isinstance(kind, types.BaseTuple):
        parts: Any = kind
        return context.make_tuple(builder, kind, [_value(context, builder, part, words) for part in parts])
    if isinstance(kind, types.Array):
        address = builder.load(builder.inttoptr(next(words), ir.IntType(8).as_pointer().as_pointer()))
        lengths = types.UniTuple(types.intp, kind.ndim)
        shape = context.make_tuple(builder, lengths, [next(words) for _ in range(kind.ndim)])
        return np_cfarray(context, builder, kind(types.voidptr, lengths), (address, shape))
    if isinstance(kind, types.Complex):
        number = context.make_complex(builder, kind)
        number.real = builder.bitcast(next(words), ir.DoubleType())
        number.imag = builder.bitcast(next(words), ir.DoubleType())
        return number._getvalue()
    return builder.bitcast(next(words), context.get_value_type(kind))


def _jit(function: Any, options: dict[str, Any], pipeline: type[Compiler]) -> Any:
    """Return Numba's form of a function that only compiled ones call, and that makes no arrays."""
    only_called = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "_nrt": False}
    return numba.njit(function, pipeline_class=pipeline, **only_called, **_OPTIONS, **options)


@typeof_impl.register(Kernel)
def _type_of_kernel(kernel: Kernel, _: Any) -> types.Dispatcher:
    """Return the type by which Numba knows a kernel."""
    if kernel not in _KERNELS:
        pipeline = _DisjointCompiler if kernel.are_disjoint else _KernelCompiler
        _KERNELS[kernel] = _jit(kernel.function, kernel.options, pipeline)
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


class _DisjointCompiler(_KernelCompiler):
    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self.state.flags.noalias = True
