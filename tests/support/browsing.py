"""Chromium of this machine, for the tests of the page."""

import os
import shutil
from collections.abc import Callable

from playwright.sync_api import Page

Open = Callable[..., Page]

_NAMES = ("chromium", "chromium-browser", "google-chrome")
# As root there is no sandbox, and without a graphics card WebGL is in software.
ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def chromium() -> str | None:
    """Return the program: what CONFLICTDB_TEST_BROWSER names, else the first that is installed; None if none is."""
    return os.environ.get("CONFLICTDB_TEST_BROWSER") or next(filter(None, map(shutil.which, _NAMES)), None)
