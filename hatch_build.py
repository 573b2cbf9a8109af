"""Compiles the kernel when a wheel is built or the source tree is installed; see conflictdb/kernel/build.py."""

import importlib.util
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class KernelHook(BuildHookInterface[Any]):
    """Puts the compiled kernel into the wheel, which is of one platform then, and of any Python 3."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile; `version` is "editable" where the source tree itself is installed."""
        if self.target_name != "wheel":
            return
        spec = importlib.util.spec_from_file_location("build", Path(self.root) / "conflictdb" / "kernel" / "build.py")
        assert spec is not None
        assert spec.loader is not None
        build = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(build)
        library = build.build()
        if version != "editable":
            platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
            build_data["artifacts"].append(library.relative_to(self.root).as_posix())
            build_data.update(pure_python=False, tag=f"py3-none-{platform}")
