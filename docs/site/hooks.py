"""What the site does with the documents: the file that opens a directory is README.md; links out of docs/ are named."""

import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

# Files beside docs/ are no pages: their links say which file is meant.
_OUTSIDE = re.compile(r"\[([^\]]+)\]\((?:\.\./)+([A-Z]+\.md|sql|tests|benchmarks|deploy)[^)\s]*\)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the changelog, which is beside docs/."""
    changes = Path(config.docs_dir).parent / "CHANGELOG.md"
    if changes.exists():
        files.append(File.generated(config, changes.name, abs_src_path=str(changes)))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Return a page in which links to files that the site has not are text."""
    return _OUTSIDE.sub(r"\1 (`\2`)", markdown)
