"""A vector of 16 float32 values for kernels: `load`, `store`, arithmetic, selection.

Numba's automatic vectoriser is easily defeated (aliasing checks, loops that
are unrolled too early), and whether it fires decides a factor of five. Here
the vector is a type of its own, lowered to LLVM's ``<16 x float>``: what a
kernel writes is what the machine runs, one instruction per operator with
AVX-512, two with AVX2, four with SSE or NEON. The operators carry LLVM's
``contract`` flag (a product and a sum may be fused) and no other.

With `NUMBA_DISABLE_JIT=1` the same functions work on NumPy rows of 16, so
that kernels can be stepped through and measured for coverage.
"""

import operator
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import types
from numba.core.datamodel import PrimitiveModel, register_default
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic

LANES = 16
"""Values in a vector; the last axis of every state array."""

_VECTOR = ir.VectorType(ir.FloatType(), LANES)
_INDEX = ir.IntType(32)
_CONTRACT = ("contract",)


class VectorType(types.Type):
    """Numba's type for 16 float32 values in one register."""

    def __init__(self) -> None:
        super().__init__(name=f"float32x{LANES}")


vector = VectorType()


@register_default(VectorType)
class _VectorModel(PrimitiveModel):  # type: ignore[misc]
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, _VECTOR)


def _broadcast(builder: Any, value: Any) -> Any:
    """LLVM idiom for a splat: insert into lane 0, shuffle lane 0 everywhere."""
    undefined = ir.Constant(_VECTOR, ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(_INDEX, 0))
    lane_zero = ir.Constant(ir.VectorType(_INDEX, LANES), None)
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
        return getattr(builder, instruction)(*operands, flags=_CONTRACT)

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
    array = context.make_array(sig.args[0])(context, builder, args[0])
    offset = builder.mul(args[1], ir.Constant(args[1].type, LANES))
    return builder.bitcast(builder.gep(array.data, [offset]), _VECTOR.as_pointer())


def _llvm_math(name: str) -> Callable[[Any, Any, Any, Any], Any]:
    """Code generator that calls an LLVM vector intrinsic such as ``llvm.sqrt``."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        function_type = ir.FunctionType(_VECTOR, [_VECTOR] * len(args))
        full_name = f"llvm.{name}.v{LANES}f32"
        return builder.call(
            builder.module.globals.get(full_name)
            or ir.Function(builder.module, function_type, full_name),
            args,
        )

    return generate


if numba.config.DISABLE_JIT:

    def load(array: Any, row: int) -> Any:
        """Row `row` of a C-contiguous float32 array, seen as rows of 16 values."""
        return array.reshape(-1, LANES)[row].copy()

    def store(array: Any, row: int, value: Any) -> None:
        """Write a vector to row `row` of a C-contiguous float32 array."""
        array.reshape(-1, LANES)[row] = value

    def splat(value: float) -> Any:
        """The same value in all 16 lanes."""
        return np.full(LANES, value, dtype=np.float32)

    def sqrt(value: Any) -> Any:
        """Square root, lane by lane."""
        return np.sqrt(value)

    def minimum(a: Any, b: Any) -> Any:
        """Smaller value, lane by lane."""
        return np.minimum(a, b)

    def maximum(a: Any, b: Any) -> Any:
        """Larger value, lane by lane."""
        return np.maximum(a, b)

    def where_less(a: Any, b: Any, then: Any, otherwise: Any) -> Any:
        """`then` in the lanes where a < b, `otherwise` in the others."""
        return np.where(a < b, then, otherwise)

    def any_less(a: Any, b: Any) -> bool:
        """Whether a < b in any lane."""
        return bool(np.any(a < b))

else:

    @intrinsic  # type: ignore[untyped-decorator]
    def load(typingctx: Any, array: Any, row: Any) -> Any:
        """Row `row` of a C-contiguous float32 array, seen as rows of 16 values."""

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
        """The same value in all 16 lanes."""

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            return _as_vector(context, builder, args[0], sig.args[0])

        return vector(value), generate

    @intrinsic  # type: ignore[untyped-decorator]
    def sqrt(typingctx: Any, value: Any) -> Any:
        """Square root, lane by lane."""
        return vector(vector), _llvm_math("sqrt")

    @intrinsic  # type: ignore[untyped-decorator]
    def minimum(typingctx: Any, a: Any, b: Any) -> Any:
        """Smaller value, lane by lane."""
        return vector(vector, vector), _llvm_math("minnum")

    @intrinsic  # type: ignore[untyped-decorator]
    def maximum(typingctx: Any, a: Any, b: Any) -> Any:
        """Larger value, lane by lane."""
        return vector(vector, vector), _llvm_math("maxnum")

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
