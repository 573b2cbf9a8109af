"""Compiles the kernel when a wheel is built or the source tree is installed; see conflictdb/kernel/build.py."""

import importlib.util
import os
import sysconfig
from pathlib import Path
from types import ModuleType
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

KERNEL = "conflictdb/kernel"


class KernelHook(BuildHookInterface[Any]):
    """Puts the compiled kernel into the wheel, which is of one platform then, and of any Python 3.

    That is of this platform; or what tools/build_wheels.py compiled for another, which it names in the environment.
    """

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile; `version` is "editable" where the source tree itself is installed."""
        if self.target_name != "wheel":
            return
        build, library = _build_of(self.root), os.environ.get("CONFLICTDB_WHEEL_LIBRARY")
        platform = os.environ.get("CONFLICTDB_WHEEL_PLATFORM", sysconfig.get_platform())
        compiled = Path(library) if library else build.build()
        if version != "editable":
            tag = f"py3-none-{platform.replace('-', '_').replace('.', '_')}"
            build_data["force_include"][str(compiled)] = f"{KERNEL}/{build.LIBRARY}"
            build_data.update(pure_python=False, tag=tag)


def _build_of(root: str) -> ModuleType:
    """Return build.py as a module: what it belongs to is not installed yet."""
    spec = importlib.util.spec_from_file_location("build", Path(root) / KERNEL / "build.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
