"""The functions of `kernel` as machine code in a file.

Only the process that makes the file imports numba, which takes half a second, and compiles, which
takes seconds; others load the file with llvmlite in a fiftieth of a second. The file's name has a
digest of the sources and of the processor, so that no other code is loaded.
"""

from __future__ import annotations

from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

from llvmlite import binding as llvm

from islandgp.cached_files import read_cached, store
from islandgp.domains.island import engine


def is_cached() -> bool:
    """True if the machine code of this version and processor is in a file."""
    return read_cached(__file__, _name()) is not None


@cache
def addresses() -> dict[str, int]:
    """The address of each function of `kernel.FUNCTIONS`, by name.

    Raises:
        ImportError, RuntimeError: it has to be compiled, and numba does not work.
        OSError: no folder takes the file.
    """
    for name, address in engine.addresses.items():
        llvm.add_symbol(name, address)
    code = read_cached(__file__, name := _name())
    if code is None:
        code = _compiled()
        store(__file__, name, code)
    executor = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _target())
    executor.add_object_file(llvm.ObjectFileRef.from_data(code))
    executor.finalize_object()
    _EXECUTORS.append(executor)
    names = ("run", "look", "coast")
    return {name: executor.get_function_address(f"island_{name}") for name in names}


_EXECUTORS: Final[list[Any]] = []  # they own the memory of the code


def _target() -> Any:
    """LLVM's description of this processor."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(),
        features=llvm.get_host_cpu_features().flatten(),
        opt=3,
        jit=True,
        codemodel="jitdefault",
    )


def _compiled() -> bytes:
    """Compiles the functions with numba; returns an object file."""
    from islandgp.domains.island import kernel

    functions: dict[str, Any] = kernel.FUNCTIONS
    program = llvm.parse_assembly("")
    for name, function in functions.items():
        module = llvm.parse_assembly(function.inspect_llvm(function.signatures[0]))
        (entry,) = (
            f
            for f in module.functions
            if f.linkage == llvm.Linkage.external and not f.is_declaration
        )
        entry.name = f"island_{name}"
        program.link_in(module)
    code: bytes = _target().emit_object(program)
    return code


def _name() -> str:
    """The name of the file for this version and processor."""
    digest = sha256()
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    for text in (
        llvm.get_process_triple(),
        llvm.get_host_cpu_name(),
        llvm.get_host_cpu_features().flatten(),
    ):
        digest.update(text.encode())
    return f"kernel-{digest.hexdigest()[:16]}.o"
