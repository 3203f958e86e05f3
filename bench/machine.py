"""The machine and the versions, in words: figures without them mean nothing."""

from __future__ import annotations

import os
import platform
from importlib import metadata
from pathlib import Path

PACKAGES = ("numpy", "scipy", "qdldl", "casadi")


def machine() -> str:
    """The machine in words, as in "2-core x86-64 virtual machine, 2.6 GHz AMD EPYC, Linux"."""
    facts = _processor()
    kind = "virtual machine" if "hypervisor" in facts.get("flags", "").split() else "machine"
    architecture = platform.machine().replace("_", "-")
    model = facts.get("model name", "processor of unknown make")
    clock = f"{float(facts['cpu MHz']) / 1000:.1f} GHz " if "cpu MHz" in facts else ""
    return f"{os.cpu_count()}-core {architecture} {kind}, {clock}{model}, {platform.system()}"


def versions() -> str:
    """Python and the packages that do the work, with their versions."""
    found = ", ".join(f"{name} {metadata.version(name)}" for name in PACKAGES)
    return f"Python {platform.python_version()}, {found}"


def _processor() -> dict[str, str]:
    """What the system says of its first processor; nothing where it does not say it in this form."""
    path = Path("/proc/cpuinfo")
    if not path.exists():
        return {}
    first = path.read_text(encoding="utf-8").split("\n\n")[0]
    pairs = (line.split(":", 1) for line in first.splitlines() if ":" in line)
    return {key.strip(): value.strip() for key, value in pairs}
