"""Write a bill of materials (CycloneDX 1.6, JSON): the pinned packages, and third-party code inside conflictdb.

    ./run python tools/sbom.py > conflictdb.cdx.json

Made from the files of pins alone: the same commit gives the same bytes, on any machine.
"""

import json
import re
import sys
import tomllib
import uuid
from pathlib import Path
from typing import Any, Final

ROOT = Path(__file__).resolve().parents[1]
# Packages of run time, then those that extras add.
PINS: Final = (
    ("requirements.txt", "required"),
    ("requirements-extras.txt", "optional"),
    ("requirements-spark.txt", "optional"),
)
VENDORED: Final = ROOT / "conflictdb" / "map" / "vendor" / "vendor.json"
_SPACE: Final = uuid.uuid5(uuid.NAMESPACE_DNS, "conflictdb")


def bill() -> dict[str, Any]:
    """Return the bill of materials."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        project = tomllib.load(file)["project"]
    components: dict[str, dict[str, Any]] = {}
    for file_name, scope in PINS:
        for component in _pinned((ROOT / file_name).read_text(), scope):
            components.setdefault(component["bom-ref"], component)
    for component in _vendored(json.loads(VENDORED.read_text())):
        components[component["bom-ref"]] = component
    parts = [components[name] for name in sorted(components)]
    root = f"pkg:pypi/{project['name']}@{project['version']}"
    made = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {
            "component": {
                "type": "application",
                "bom-ref": root,
                "name": project["name"],
                "version": project["version"],
                "description": project["description"],
                "licenses": [{"expression": project["license"]}],
                "purl": root,
            }
        },
        "components": parts,
        "dependencies": [{"ref": root, "dependsOn": [part["bom-ref"] for part in parts]}],
    }
    return {"serialNumber": f"urn:uuid:{uuid.uuid5(_SPACE, json.dumps(made))}", **made}


def _pinned(text: str, scope: str) -> list[dict[str, Any]]:
    """Return the packages of a file of pins; the digests are those of all files of a package, of any platform."""
    text = re.sub(r"^#.*\n", "", text, flags=re.MULTILINE).replace("\\\n", " ")
    found = []
    for line in filter(str.strip, text.splitlines()):
        match = re.match(r"([A-Za-z0-9._-]+)==([^\s;]+)\s*(?:;\s*(.*?))?\s*(?=--hash|$)", line)
        if match is None:
            raise ValueError(f"not a pin: {line!r:.80}")
        name, version, marker = match[1].lower(), match[2], match[3]
        purl = f"pkg:pypi/{name}@{version}"
        properties = [{"name": "conflictdb:sha256", "value": digest} for digest in re.findall(r"sha256:(\w+)", line)]
        if marker:
            properties.append({"name": "conflictdb:marker", "value": marker})
        found.append(
            {
                "type": "library",
                "bom-ref": purl,
                "name": name,
                "version": version,
                "scope": scope,
                "purl": purl,
                "properties": properties,
            }
        )
    return found


def _vendored(listed: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the libraries and data that the page of `conflictdb map` contains."""
    return [
        {
            "type": "library",
            "bom-ref": f"pkg:npm/{name}@{one['version']}",
            "name": name,
            "version": one["version"],
            "scope": "required",
            "licenses": [{"license": {"id": one["licence"].partition(";")[0]}}],
            "purl": f"pkg:npm/{name}@{one['version']}",
            "components": [
                {"type": "file", "name": file, "hashes": [{"alg": "SHA-256", "content": digest}]}
                for file, digest in one["sha256"].items()
            ],
        }
        for name, one in listed.items()
    ]


def text() -> str:
    """Return the bill of materials as JSON."""
    return json.dumps(bill(), indent=1) + "\n"


if __name__ == "__main__":
    sys.stdout.write(text())
