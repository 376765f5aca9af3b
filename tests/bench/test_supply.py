"""The audit of the locks: licences, wholeness, advisories, and the list in docs/tables/licences.md."""

import base64
import hashlib
import importlib.metadata as metadata
import json
from email.message import Message

import pytest

from bench.supply import (
    LOCKS,
    PAGE,
    ROOT,
    changed_files,
    faults_of_pins,
    is_allowed,
    licence,
    listed_licences,
    pins,
    renewed,
    warned,
)


def about(**fields):
    found = Message()
    for name, value in fields.items():
        found[name.replace("_", "-")] = value
    return found


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"License_Expression": "Apache-2.0 OR BSD-2-Clause"}, "Apache-2.0 OR BSD-2-Clause"),
        ({"License": "BSD-3-Clause", "Classifier": "License :: OSI Approved :: BSD License"}, "BSD-3-Clause"),
        ({"License": "UNKNOWN", "Classifier": "License :: OSI Approved :: ISC License (ISCL)"}, "ISC"),
        ({"License": "MIT License\n\nCopyright of the Submitter"}, "MIT"),
        ({"License": "Proprietary"}, "unknown"),
        ({"Classifier": "Topic :: Software Development"}, "unknown"),
    ],
)
def test_a_licence_is_read_however_it_is_spelled(fields, expected):
    assert licence(about(**fields)) == expected


@pytest.mark.parametrize(
    ("expression", "allowed"),
    [
        ("MIT", True),
        ("BSD-2-Clause AND Apache-2.0 WITH LLVM-exception", True),
        ("GPL-3.0-only OR MIT", True),
        ("MIT AND GPL-3.0-only", False),
        ("unknown", False),
    ],
)
def test_what_is_allowed(expression, allowed):
    assert is_allowed(expression) is allowed


def test_a_pin_that_is_not_installed_another_version_and_a_lacking_requirement_are_found():
    pinned = pins(ROOT / "requirements.lock")
    assert "numpy" in pinned
    alone = {"pandas": pinned["pandas"], "no-such-package": "1.0", "tomlkit": "0.0.1"}
    found = " | ".join(faults_of_pins(alone, "a.lock"))
    assert "a.lock: no-such-package is not installed" in found
    assert f"tomlkit 0.0.1 is pinned, {pinned['tomlkit']} is installed" in found
    assert "pandas needs numpy, which is not pinned" in found


def test_a_file_that_was_changed_after_installation_is_found(tmp_path):
    files = {"acme/__init__.py": b"ONE = 1\n", "acme/lost.py": b"", "acme/same.py": b"x = 2\n"}
    lines = []
    for name, content in files.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)
        digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
        lines.append(f"{name},sha256={digest},{len(content)}\n")
    info = tmp_path / "acme-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme\nVersion: 1.0\n")
    (info / "RECORD").write_text("".join(lines))
    package = metadata.Distribution.at(info)
    assert list(changed_files(package)) == []
    (tmp_path / "acme/__init__.py").write_bytes(b"ONE = 2\n")
    (tmp_path / "acme/lost.py").unlink()
    assert list(changed_files(package)) == ["acme/__init__.py is not as it was installed", "acme/lost.py is missing"]


@pytest.mark.parametrize(
    ("affected", "hit"),
    [
        ({"ranges": [{"type": "ECOSYSTEM", "events": [{"introduced": "0"}, {"fixed": "2.1"}]}]}, True),
        ({"ranges": [{"type": "ECOSYSTEM", "events": [{"introduced": "0"}, {"fixed": "2.0"}]}]}, False),
        ({"ranges": [{"type": "ECOSYSTEM", "events": [{"introduced": "2.0"}, {"last_affected": "2.0"}]}]}, True),
        ({"ranges": [{"type": "ECOSYSTEM", "events": [{"introduced": "2.0.1"}]}]}, False),
        ({"ranges": [{"type": "GIT", "events": [{"introduced": "0"}]}], "versions": ["1.9"]}, False),
        ({"versions": ["1.9", "2.0"]}, True),
    ],
)
def test_advisories_are_matched_by_version(tmp_path, affected, hit):
    known = {"id": "PYSEC-0", "summary": "lets strangers in", "affected": [{**affected}]}
    known["affected"][0]["package"] = {"ecosystem": "PyPI", "name": "Acme_Tools"}
    (tmp_path / "PYSEC-0.json").write_text(json.dumps(known))
    (tmp_path / "PYSEC-1.json").write_text(json.dumps({**known, "id": "PYSEC-1", "withdrawn": "2024-01-01T00:00:00Z"}))
    found = list(warned({"acme-tools": "2.0", "other": "2.0"}, tmp_path))
    assert found == (["acme-tools 2.0: PYSEC-0: lets strangers in"] if hit else [])


def test_the_page_lists_the_licences_of_all_pins():
    for name in LOCKS:
        for package in pins(ROOT / name):
            try:
                metadata.metadata(package)
            except metadata.PackageNotFoundError:
                pytest.skip(f"{package} of {name} is not installed")
    page = PAGE.read_text(encoding="utf-8")
    assert renewed(page, listed_licences()) == page, "python -m bench.supply --page renews it"
