"""From LLVM text to machine code in memory, by LLVM's optimiser for this processor."""

from __future__ import annotations

import itertools
import threading
from functools import lru_cache
from typing import Any

__all__ = ["compiled", "loaded", "processor"]

LEVEL = 3
_numbers = itertools.count()
_lock = threading.RLock()
_kept: list[Any] = []


@lru_cache(maxsize=1)
def _target() -> Any:
    from llvmlite import binding

    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    target = binding.Target.from_default_triple()
    return target.create_target_machine(
        cpu=binding.get_host_cpu_name(), features=binding.get_host_cpu_features().flatten(), opt=LEVEL, reloc="pic",
        codemodel="default", jit=True,
    )  # fmt: skip


@lru_cache(maxsize=1)
def processor() -> str:
    """Return what machine code depends on: LLVM's version and the processor with its features."""
    import llvmlite
    from llvmlite import binding

    features = binding.get_host_cpu_features().flatten()
    return "\n".join((llvmlite.__version__, str(LEVEL), binding.get_host_cpu_name(), features))


def compiled(text: str) -> bytes:
    """Return the object code of a program in LLVM's language."""
    from llvmlite import binding

    with _lock:
        target = _target()
        module = binding.parse_assembly(text)
        module.triple, module.data_layout = target.triple, str(target.target_data)
        options = binding.create_pipeline_tuning_options(speed_level=LEVEL)
        # Vectors made from straight text (slp) took four times as long to compile and ran slower: left off.
        options.loop_vectorization, options.loop_unrolling = True, False
        builder = binding.create_pass_builder(target, options)
        builder.getModulePassManager().run(module, builder)
        return target.emit_object(module)


@lru_cache(maxsize=1)
def _session() -> Any:
    from llvmlite import binding

    return binding.create_lljit_compiler(_target())


def loaded(code: bytes, symbol: str) -> int:
    """Put object code into memory, for as long as the process lives, and return a symbol's address.

    Raises
    ------
    ValueError
        If the code cannot be used.
    """
    from llvmlite import binding

    with _lock:
        library = binding.JITLibraryBuilder().add_current_process().add_object_img(code).export_symbol(symbol)
        try:
            tracker = library.link(_session(), f"vtsdt{next(_numbers)}")
        except RuntimeError as error:
            raise ValueError(str(error)) from error
        _kept.append(tracker)
        return int(tracker[symbol])
