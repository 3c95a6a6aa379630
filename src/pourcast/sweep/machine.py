"""The machine that simulations run on, in words."""

import platform
import subprocess
from pathlib import Path

import llvmlite.binding
import numba

from pourcast.engine.batch import available_cores
from pourcast.engine.simd import LANES

_VECTORS = {
    "avx512f": "AVX-512",
    "avx2": "AVX2",
    "avx": "AVX",
    "sse2": "SSE2",
    "neon": "NEON",
}
"""Names of vector instructions by LLVM's names of features, the widest first."""


def describe_machine() -> dict[str, str | int]:
    """Processor, number of cores that this process may use, vector instructions and lanes."""
    return {
        "processor": processor_name(),
        "cores": available_cores(),
        "vectors": vector_instructions(),
        "lanes": LANES,
    }


def processor_name() -> str:
    """The processor's name as its maker gives it, or else its architecture."""
    if platform.system() == "Darwin":
        asked = ["/usr/sbin/sysctl", "-n", "machdep.cpu.brand_string"]
        return subprocess.run(asked, check=True, capture_output=True, text=True).stdout.strip()
    listed = Path("/proc/cpuinfo")
    if listed.exists():
        for line in listed.read_text(encoding="utf-8").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()


def vector_instructions() -> str:
    """The widest vector instructions that kernels are compiled for, in this process."""
    # Numba's own words, set where a machine is to be taken for a lesser one.
    features = numba.config.CPU_FEATURES or llvmlite.binding.get_host_cpu_features().flatten()
    enabled = {word.removeprefix("+") for word in features.split(",") if word.startswith("+")}
    return next((name for feature, name in _VECTORS.items() if feature in enabled), "none known")
