"""A vector of float32 values for kernels: `load`, `store`, arithmetic, selection.

Numba's automatic vectoriser is easily defeated (aliasing checks, loops that
are unrolled too early), and whether it fires decides a factor of five. Here
the vector is a type of its own, lowered to LLVM's ``<LANES x float>``: what a
kernel writes is what the machine runs, one instruction per operator. A vector
is as wide as the machine's registers: twice as wide ones are cut in two, and
what a loop over pairs needs is then more than the registers hold.

The operators carry none of LLVM's flags: a product and a sum are fused where a
kernel says `fma`, and nowhere else. So a result doesn't depend on the width of
the vector, on the kernel that it is computed in, or on the compiler.

With `NUMBA_DISABLE_JIT=1` the same functions work on NumPy rows, so that
kernels can be stepped through and measured for coverage.
"""

import operator
import platform
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import types
from numba.core.codegen import get_host_cpu_features
from numba.core.datamodel import PrimitiveModel, register_default
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic

from pourcast.engine.compile import kernel


def _machine_features() -> set[str]:
    """Features of the processor that Numba compiles for, such as ``avx2``; LLVM's names."""
    listed = numba.config.CPU_FEATURES
    text = get_host_cpu_features() if listed is None else listed
    return {name[1:] for name in text.split(",") if name.startswith("+")}


def _machine_lanes(features: set[str]) -> int:
    # By LLVM's models of processors, 8 lanes in two registers of Arm's cost a simulation the same
    # in lockstep on a Neoverse N2, a fifth less on an Apple M1 (the model of an older core). Single
    # simulations would lose it again: clusters of 8 have more partners that are near few of them.
    if "avx512f" in features:
        return 16
    return 8 if "avx" in features else 4


_FEATURES = _machine_features()

LANES = _machine_lanes(_FEATURES)
"""Values in a vector, by the machine: 16 with AVX-512, 8 with AVX, else 4 (SSE, NEON). The last
axis of every state array."""

_FUSES = "fma" in _FEATURES or platform.machine() in ("aarch64", "arm64")
"""Whether the machine adds a product in one instruction; without, LLVM calls a slow function."""

_VECTOR = ir.VectorType(ir.FloatType(), LANES)
_INDEX = ir.IntType(32)
_INDICES = ir.VectorType(_INDEX, LANES)
_MASK = ir.VectorType(ir.IntType(1), LANES)
_FLOAT_SIZE = 4
_ALIGNMENT = ir.Constant(_INDEX, _FLOAT_SIZE)
_MXCSR_FTZ_DAZ = 0x8040
_FPCR_FZ = 1 << 24


class VectorType(types.Type):
    """Numba's type for `LANES` float32 values in one register."""

    def __init__(self) -> None:
        super().__init__(name=f"float32x{LANES}")


vector = VectorType()


@register_default(VectorType)
class _VectorModel(PrimitiveModel):  # type: ignore[misc]
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, _VECTOR)


def _broadcast(builder: Any, value: Any) -> Any:
    """LLVM idiom for a splat: insert into lane 0, shuffle lane 0 everywhere."""
    undefined = ir.Constant(ir.VectorType(value.type, LANES), ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(_INDEX, 0))
    lane_zero = ir.Constant(_INDICES, None)
    return builder.shuffle_vector(first, undefined, lane_zero)


def _as_vector(context: Any, builder: Any, value: Any, value_type: Any) -> Any:
    if value_type == vector:
        return value
    return _broadcast(builder, context.cast(builder, value, value_type, types.float32))


def _register_operator(python_operator: Callable[..., Any], instruction: str) -> None:
    scalars = (types.float32, types.float64)
    cases = [signature(vector, vector, vector)]
    cases += [signature(vector, vector, scalar) for scalar in scalars]
    cases += [signature(vector, scalar, vector) for scalar in scalars]
    infer_global(python_operator)(type("VectorOperator", (ConcreteTemplate,), {"cases": cases}))

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        operands = [
            _as_vector(context, builder, value, value_type)
            for value, value_type in zip(args, sig.args, strict=True)
        ]
        return getattr(builder, instruction)(*operands)

    for case in cases:
        lower_builtin(python_operator, *case.args)(lower)


for _operator, _instruction in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _register_operator(_operator, _instruction)


def _row_pointer(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    index = builder.mul(args[1], ir.Constant(args[1].type, LANES))
    return _pointer_at(context, builder, sig.args[0], args[0], index)


def _pointer_at(
    context: Any, builder: Any, array_type: Any, array: Any, index: Any, content: Any = _VECTOR
) -> Any:
    """Pointer to `LANES` values of a C-contiguous array from an index on."""
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), content.as_pointer())


def _intrinsic_function(builder: Any, name: str, result: Any, arguments: Any) -> Any:
    """The declaration of an LLVM intrinsic in the module under construction."""
    known = builder.module.globals.get(name)
    return known or ir.Function(builder.module, ir.FunctionType(result, arguments), name)


def _before(builder: Any, count: Any) -> Any:
    """Mask of the first `count` lanes."""
    lanes = ir.Constant(_INDICES, list(range(LANES)))
    return builder.icmp_signed("<", lanes, _broadcast(builder, builder.trunc(count, _INDEX)))


def _listed_pointers(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Pointers to values of an array, args[0], at the indices listed in args[1] from args[2] on."""
    data = context.make_array(sig.args[0])(context, builder, args[0]).data
    indices = builder.load(
        _pointer_at(context, builder, sig.args[1], args[1], args[2], _INDICES), align=4
    )
    # llvmlite's getelementptr takes no vector of indices.
    wide = ir.VectorType(ir.IntType(64), LANES)
    start = _broadcast(builder, builder.ptrtoint(data, wide.element))
    offsets = builder.mul(builder.sext(indices, wide), ir.Constant(wide, [_FLOAT_SIZE] * LANES))
    pointers = ir.VectorType(data.type, LANES)
    return builder.inttoptr(builder.add(start, offsets), pointers)


def _llvm_math(name: str) -> Callable[[Any, Any, Any, Any], Any]:
    """Code generator that calls an LLVM vector intrinsic such as ``llvm.sqrt``."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        full_name = f"llvm.{name}.v{LANES}f32"
        function = _intrinsic_function(builder, full_name, _VECTOR, [_VECTOR] * len(args))
        return builder.call(function, args)

    return generate


def _fused(a: Any, b: Any, c: Any, *, negated: bool) -> Any:
    """Signature and code generator of `fma`, of `fnma` if the product is subtracted."""
    kind = vector if vector in (a, b, c) else types.float64

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        a, b, c = (
            _as_vector(context, builder, value, value_type)
            if kind == vector
            else context.cast(builder, value, value_type, kind)
            for value, value_type in zip(args, sig.args, strict=True)
        )
        a = builder.fneg(a) if negated else a
        if not _FUSES:
            return builder.fadd(builder.fmul(a, b), c)
        name = f"v{LANES}f32" if kind == vector else "f64"
        function = _intrinsic_function(builder, f"llvm.fma.{name}", a.type, [a.type] * 3)
        return builder.call(function, (a, b, c))

    return kind(a, b, c), generate


def _second_if(comparison: str) -> Callable[[Any, Any, Any, Any], Any]:
    """Code generator that takes the second of two vectors where it compares so to the first.

    LLVM's own minnum and maxnum would drop what is no number, and take two more instructions.
    """

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        first, second = args
        return builder.select(builder.fcmp_ordered(comparison, second, first), second, first)

    return generate


if numba.config.DISABLE_JIT:

    def load(array: Any, row: int) -> Any:
        """Row `row` of a C-contiguous float32 array, seen as rows of `LANES` values."""
        return array.reshape(-1, LANES)[row].copy()

    def store(array: Any, row: int, value: Any) -> None:
        """Write a vector to row `row` of a C-contiguous float32 array."""
        array.reshape(-1, LANES)[row] = value

    def splat(value: float) -> Any:
        """The same value in all lanes."""
        return np.full(LANES, value, dtype=np.float32)

    def sqrt(value: Any) -> Any:
        """Square root, lane by lane."""
        return np.sqrt(value)

    def fma(a: Any, b: Any, c: Any) -> Any:
        """``a * b + c``, rounded once; of vectors, numbers or both."""
        exact = np.asarray(a, np.float64) * b + c
        return exact.astype(np.float32) if exact.shape else float(exact)

    def fnma(a: Any, b: Any, c: Any) -> Any:
        """``c - a * b``, rounded once; of vectors, numbers or both."""
        return fma(-a, b, c)

    def minimum(a: Any, b: Any) -> Any:
        """`b` in the lanes where it is smaller, else `a`: what is no number in `a` stays."""
        return np.where(b < a, b, a)

    def maximum(a: Any, b: Any) -> Any:
        """`b` in the lanes where it is larger, else `a`: what is no number in `a` stays."""
        return np.where(b > a, b, a)

    def where_less(a: Any, b: Any, then: Any, otherwise: Any) -> Any:
        """`then` in the lanes where a < b, `otherwise` in the others."""
        return np.where(a < b, then, otherwise)

    def any_less(a: Any, b: Any) -> bool:
        """Whether a < b in any lane."""
        return bool(np.any(a < b))

    def bits_less(a: Any, b: Any) -> int:
        """An integer whose bits, from the lowest on, say in which lanes a < b."""
        return sum(1 << int(lane) for lane in np.flatnonzero(a < b))

    def lowest_bit(bits: int) -> int:
        """Place of the lowest bit of a positive integer that is 1."""
        return (int(bits) & -int(bits)).bit_length() - 1

    def _set_flush_mode() -> None:
        """NumPy's mode is not ours to set."""

    def load_from(array: Any, first: int) -> Any:
        """The `LANES` values of a float32 array from index `first` on."""
        return array[first : first + LANES].copy()

    def gather(array: Any, indices: Any, first: int) -> Any:
        """Values of a float32 array at the `LANES` indices (int32) listed from `first` on."""
        return array[indices[first : first + LANES]]

    def scatter(array: Any, indices: Any, first: int, value: Any) -> None:
        """Write a vector to the indices listed from `first` on, all different."""
        array[indices[first : first + LANES]] = value

    def first_lanes(value: Any, count: int) -> Any:
        """The value in the first `count` lanes, 0 in the others."""
        return np.where(np.arange(LANES) < count, value, np.float32(0.0))

    def first_lane(value: Any) -> Any:
        """The value in the first lane."""
        return value[0]

    def sum_lanes(value: Any) -> Any:
        """Sum over the lanes: halves are added until one value is left."""
        while len(value) > 1:
            half = len(value) // 2
            value = value[:half] + value[half:]
        return value[0]

else:

    @intrinsic  # type: ignore[untyped-decorator]
    def load(typingctx: Any, array: Any, row: Any) -> Any:
        """Row `row` of a C-contiguous float32 array, seen as rows of `LANES` values."""

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            return builder.load(_row_pointer(context, builder, sig, args), align=4)

        return vector(array, types.intp), generate

    @intrinsic  # type: ignore[untyped-decorator]
    def store(typingctx: Any, array: Any, row: Any, value: Any) -> Any:
        """Write a vector to row `row` of a C-contiguous float32 array."""

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            builder.store(args[2], _row_pointer(context, builder, sig, args), align=4)
            return context.get_dummy_value()

        return types.void(array, types.intp, vector), generate

    @intrinsic  # type: ignore[untyped-decorator]
    def splat(typingctx: Any, value: Any) -> Any:
        """The same value in all lanes."""

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            return _as_vector(context, builder, args[0], sig.args[0])

        return vector(value), generate

    @intrinsic  # type: ignore[untyped-decorator]
    def sqrt(typingctx: Any, value: Any) -> Any:
        """Square root, lane by lane."""
        return vector(vector), _llvm_math("sqrt")

    @intrinsic  # type: ignore[untyped-decorator]
    def fma(typingctx: Any, a: Any, b: Any, c: Any) -> Any:
        """``a * b + c``, rounded once where the machine can; of vectors, numbers or both."""
        return _fused(a, b, c, negated=False)

    @intrinsic  # type: ignore[untyped-decorator]
    def fnma(typingctx: Any, a: Any, b: Any, c: Any) -> Any:
        """``c - a * b``, rounded once where the machine can; of vectors, numbers or both."""
        return _fused(a, b, c, negated=True)

    @intrinsic  # type: ignore[untyped-decorator]
    def minimum(typingctx: Any, a: Any, b: Any) -> Any:
        """`b` in the lanes where it is smaller, else `a`: what is no number in `a` stays."""
        return vector(vector, vector), _second_if("<")

    @intrinsic  # type: ignore[untyped-decorator]
    def maximum(typingctx: Any, a: Any, b: Any) -> Any:
        """`b` in the lanes where it is larger, else `a`: what is no number in `a` stays."""
        return vector(vector, vector), _second_if(">")

    @intrinsic  # type: ignore[untyped-decorator]
    def where_less(typingctx: Any, a: Any, b: Any, then: Any, otherwise: Any) -> Any:
        """`then` in the lanes where a < b, `otherwise` in the others."""

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            return builder.select(builder.fcmp_ordered("<", args[0], args[1]), *args[2:])

        return vector(vector, vector, vector, vector), generate

    @intrinsic  # type: ignore[untyped-decorator]
    def any_less(typingctx: Any, a: Any, b: Any) -> Any:
        """Whether a < b in any lane."""

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            mask = builder.fcmp_ordered("<", args[0], args[1])
            bits = builder.bitcast(mask, ir.IntType(LANES))
            return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

        return types.boolean(vector, vector), generate

    @intrinsic  # type: ignore[untyped-decorator]
    def bits_less(typingctx: Any, a: Any, b: Any) -> Any:
        """An integer whose bits, from the lowest on, say in which lanes a < b."""

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            mask = builder.fcmp_ordered("<", args[0], args[1])
            bits = builder.bitcast(mask, ir.IntType(LANES))
            return builder.zext(bits, ir.IntType(64))

        return types.int64(vector, vector), generate

    @intrinsic  # type: ignore[untyped-decorator]
    def lowest_bit(typingctx: Any, bits: Any) -> Any:
        """Place of the lowest bit of a positive integer that is 1."""

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

        return types.int64(types.int64), generate

    @intrinsic  # type: ignore[untyped-decorator]
    def _set_flush_mode(typingctx: Any) -> Any:
        """Set the calling thread's flush-to-zero and denormals-are-zero bits, where known."""

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            if platform.machine() in ("x86_64", "AMD64"):
                slot = builder.alloca(_INDEX)
                pointer = builder.bitcast(slot, ir.IntType(8).as_pointer())
                read, write = (
                    _intrinsic_function(
                        builder, f"llvm.x86.sse.{name}mxcsr", ir.VoidType(), [pointer.type]
                    )
                    for name in ("st", "ld")
                )
                builder.call(read, [pointer])
                mode = builder.or_(builder.load(slot), ir.Constant(_INDEX, _MXCSR_FTZ_DAZ))
                builder.store(mode, slot)
                builder.call(write, [pointer])
            elif platform.machine() in ("aarch64", "arm64"):
                word = ir.IntType(64)
                read = _intrinsic_function(builder, "llvm.aarch64.get.fpcr", word, [])
                write = _intrinsic_function(builder, "llvm.aarch64.set.fpcr", ir.VoidType(), [word])
                mode = builder.or_(builder.call(read, []), ir.Constant(word, _FPCR_FZ))
                builder.call(write, [mode])
            return context.get_dummy_value()

        return types.void(), generate

    @intrinsic  # type: ignore[untyped-decorator]
    def load_from(typingctx: Any, array: Any, first: Any) -> Any:
        """The `LANES` values of a float32 array from index `first` on."""

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            return builder.load(_pointer_at(context, builder, sig.args[0], *args), align=4)

        return vector(array, types.intp), generate

    @intrinsic  # type: ignore[untyped-decorator]
    def gather(typingctx: Any, array: Any, indices: Any, first: Any) -> Any:
        """Values of a float32 array at the `LANES` indices (int32) listed from `first` on."""

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            pointers = _listed_pointers(context, builder, sig, args)
            mask = ir.Constant(_MASK, [1] * LANES)
            arguments = [pointers, _ALIGNMENT, mask, ir.Constant(_VECTOR, ir.Undefined)]
            function = _intrinsic_function(
                builder,
                f"llvm.masked.gather.v{LANES}f32.v{LANES}p0",
                _VECTOR,
                [argument.type for argument in arguments],
            )
            return builder.call(function, arguments)

        return vector(array, indices, types.intp), generate

    @intrinsic  # type: ignore[untyped-decorator]
    def scatter(typingctx: Any, array: Any, indices: Any, first: Any, value: Any) -> Any:
        """Write a vector to the indices listed from `first` on, all different."""

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            pointers = _listed_pointers(context, builder, sig, args)
            arguments = [args[3], pointers, _ALIGNMENT, ir.Constant(_MASK, [1] * LANES)]
            function = _intrinsic_function(
                builder,
                f"llvm.masked.scatter.v{LANES}f32.v{LANES}p0",
                ir.VoidType(),
                [argument.type for argument in arguments],
            )
            builder.call(function, arguments)
            return context.get_dummy_value()

        return types.void(array, indices, types.intp, vector), generate

    @intrinsic  # type: ignore[untyped-decorator]
    def first_lanes(typingctx: Any, value: Any, count: Any) -> Any:
        """The value in the first `count` lanes, 0 in the others."""

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            return builder.select(_before(builder, args[1]), args[0], ir.Constant(_VECTOR, None))

        return vector(vector, types.intp), generate

    @intrinsic  # type: ignore[untyped-decorator]
    def first_lane(typingctx: Any, value: Any) -> Any:
        """The value in the first lane."""

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            return builder.extract_element(args[0], ir.Constant(_INDEX, 0))

        return types.float32(vector), generate

    @intrinsic  # type: ignore[untyped-decorator]
    def sum_lanes(typingctx: Any, value: Any) -> Any:
        """Sum over the lanes: halves are added until one value is left."""

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            total, width = args[0], LANES
            while width > 1:
                width //= 2
                low, high = (
                    builder.shuffle_vector(
                        total,
                        total,
                        ir.Constant(ir.VectorType(_INDEX, width), list(range(at, at + width))),
                    )
                    for at in (0, width)
                )
                total = builder.fadd(low, high)
            return builder.extract_element(total, ir.Constant(_INDEX, 0))

        return types.float32(vector), generate


@kernel
def flush_denormals() -> None:
    """Let the calling thread take numbers below 1.2e-38 for 0, where the processor can.

    On Intel's processors such numbers are slow, and a liquid that comes to rest is full of
    them: honey took three times as long. It also makes results independent of the mode
    that the host program, or a library in it (JAX, Taichi), has set.
    """
    _set_flush_mode()
