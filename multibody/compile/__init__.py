"""From assembled equations to machine code: generated source, numba, the emitter for kernels and SIMD lanes, C text.

Takes from `multibody.assembly` and what is below it.
"""
