"""The public interface is typed: mypy, strict, agrees with api.py."""

from pathlib import Path

import mypy.api

HERE = Path(__file__).parent


def test_the_public_interface_is_typed_as_programs_use_it() -> None:
    out, err, code = mypy.api.run(["--config-file", str(HERE.parents[1] / "pyproject.toml"), str(HERE / "api.py")])
    assert (code, err) == (0, ""), out
