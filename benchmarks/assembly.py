"""What the machine runs in the loops over pairs, by kind of processor.

    python -m benchmarks.assembly

prints a table in Markdown: instructions, and values fetched from the stack because the registers
are full, for one vector of pairs. LLVM makes code for processors that this machine isn't one of
too: the kernels are compiled, and not run. For Arm they are optimised as for x86, and made machine
code by LLVM's part for Arm.
"""

import os
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Target:
    """A kind of processor, in LLVM's words."""

    architecture: str
    cpu: str
    width: str
    """Features, as Numba is given them, from which the engine takes the width of its vectors."""


_AVX2 = "+sse4.2,+avx,+avx2,+fma,+bmi,+bmi2"
TARGETS = {
    "SSE": Target("x86_64", "nehalem", "+sse4.2"),
    "AVX2": Target("x86_64", "haswell", _AVX2),
    "AVX-512": Target("x86_64", "skylake-avx512", f"{_AVX2},+avx512f,+avx512dq,+avx512vl"),
    "Neoverse N1": Target("aarch64", "neoverse-n1", "+fma"),
    "Apple M1": Target("aarch64", "apple-m1", "+fma"),
}
_STACK = re.compile(r"\(%r[sb]p|\[(sp|x29)\b")
_JUMP = re.compile(r"(?:j\w+|b(?:\.\w+)?|cbn?z\s+\w+,|tbn?z\s+\w+,\s*#\w+,)\s+(\.L\w+)")


@dataclass(frozen=True)
class Loop:
    """The innermost loop that takes a square root or divides."""

    pairs: int
    """Vectors of pairs that it looks at: it does so once for each, or both."""
    instructions: int
    from_stack: int
    to_stack: int
    scalars: int
    """Operations on numbers where there should be vectors."""

    def __str__(self) -> str:
        """Per pair, as a cell of the table."""
        each = [self.instructions, self.from_stack, self.to_stack, self.scalars]
        return " / ".join(f"{number / self.pairs:.3g}" for number in each)


def hot_loop(assembly: str) -> Loop:
    """Find the innermost loop that takes a square root or divides, in LLVM's commented code."""
    code: list[str] = []
    label_at: dict[str, int] = {}
    loops: list[tuple[int, int]] = []
    for line in assembly.splitlines():
        text = line.strip()
        if label := re.match(r"(\.L\w+):", text):
            label_at[label[1]] = len(code)
        elif text and text[0] not in ".#/;" and not re.match(r"[\w$.]+:", text):
            if (jump := _JUMP.match(text)) and jump[1] in label_at:
                loops.append((label_at[jump[1]], len(code)))
            code.append(text)
    bodies = [code[start : end + 1] for start, end in loops]
    body = min((body for body in bodies if _slow_count(body)), key=len)
    on_stack = [line for line in body if _STACK.search(line)]
    to_stack = [line for line in on_stack if "Spill" in line]
    return Loop(
        pairs=_slow_count(body),
        instructions=len(body),
        from_stack=len(on_stack) - len(to_stack),
        to_stack=len(to_stack),
        scalars=sum(_is_scalar(line) for line in body),
    )


def _slow_count(body: list[str]) -> int:
    """Square roots or divisions of vectors, whatever there are more of."""
    return max(
        sum(bool(re.match(rf"v?{name}ps|f{name}\s+v", line)) for line in body)
        for name in ("sqrt", "div")
    )


def _is_scalar(line: str) -> bool:
    """Whether an instruction computes with one float."""
    return bool(re.match(r"v?(sqrt|div|mul|add|sub|min|max|fn?m(add|sub)\d*)ss\b", line)) or bool(
        re.match(r"f(sqrt|div|mul|add|sub|n?madd|n?msub)\s+s\d", line)
    )


def kernels() -> dict[str, tuple[Any, tuple[Any, ...]]]:
    """The kernels with loops over pairs, and arguments for them."""
    from pourcast.engine import clusters, density, momentum, pairs, rigid
    from pourcast.engine.state import empty_parameters, empty_state

    block = (empty_state(1), empty_parameters())
    lockstep = (*block, pairs.empty_pairs(1))
    one = (*block, clusters.empty_clusters(1), 0, 1)
    return {
        "lockstep, density": (density.add_pair_density, lockstep),
        "lockstep, forces": (momentum.add_pair_forces, lockstep),
        "lockstep, marbles": (rigid.collide_spheres, block),
        "single, density": (clusters.find_cluster_density, one),
        "single, forces": (clusters.find_cluster_forces, one),
    }


def print_row(name: str) -> None:
    """Compile the kernels for a target, by whose width Numba was started, and print its row."""
    import llvmlite.binding as llvm
    import numba

    from pourcast.engine.simd import LANES

    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    target = TARGETS[name]
    triple = f"{target.architecture}-unknown-linux-gnu"
    features = target.width if target.architecture == "x86_64" else ""
    machine = llvm.Target.from_triple(triple).create_target_machine(
        cpu=target.cpu, features=features, opt=3, reloc="pic"
    )
    machine.set_asm_verbosity(verbose=True)
    cells = []
    for kernel, arguments in kernels().values():
        kernel.for_python.compile(tuple(numba.typeof(argument) for argument in arguments))
        (compiled,) = kernel.for_python.overloads.values()
        module = llvm.parse_assembly(compiled.library.get_llvm_str())
        module.triple, module.data_layout = triple, str(machine.target_data)
        cells.append(str(hot_loop(machine.emit_assembly(module))))
    print("|", " | ".join([name, str(LANES), *cells]), "|", flush=True)


def main() -> None:
    """Print the table: each target in a process of its own, as Numba reads its settings once."""
    if sys.argv[1:]:
        print_row(sys.argv[1])
        return
    heads = ["processor", "lanes", *kernels()]
    print("Instructions / from the stack / to the stack / on single numbers, a vector of pairs:\n")
    print("|", " | ".join(heads), "|\n|", " | ".join("---" for _ in heads), "|", flush=True)
    for name, target in TARGETS.items():
        with tempfile.TemporaryDirectory() as cache:  # code from Numba's cache can't be looked at
            numba_settings = {
                "NUMBA_CPU_NAME": "generic",
                "NUMBA_CPU_FEATURES": target.width,
                "NUMBA_CACHE_DIR": cache,
            }
            command = [sys.executable, "-m", "benchmarks.assembly", name]
            subprocess.run(command, env=os.environ | numba_settings, check=True)


if __name__ == "__main__":
    main()
