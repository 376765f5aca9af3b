"""An FMU as a file: description, sources, and the library that this machine's compiler makes of them."""

from __future__ import annotations

import io
import platform
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping
from importlib import resources
from pathlib import Path

from harness.common.errors import UserError
from harness.common.files import write_files
from harness.realtime.export.fmi.component import FmuComponent
from harness.realtime.export.fmi.description import FLAGS, build_description, compiled_files, description

COMPILERS = ("cc", "gcc", "clang")
_ENTRIES = (1980, 1, 1, 0, 0, 0)
"""Time of all entries: the same FMU has the same bytes."""


def fmu(component: FmuComponent, version: int) -> tuple[bytes, bool]:
    """Return an FMU, and whether it has a library for this machine: not where there is no compiler.

    Args:
        component: What it is of.
        version: Of FMI, 2 or 3.

    Raises:
        UserError: If the compiler fails.
    """
    texts = sources(component, version)
    contents: dict[str, str | bytes] = {"modelDescription.xml": description(component, version)}
    contents |= {f"sources/{name}": text for name, text in texts.items()}
    if version == 3:
        contents["sources/buildDescription.xml"] = build_description(component)
    compiler = next(filter(None, map(shutil.which, COMPILERS)), None)
    if compiler is not None:
        folder, extension = binary_place(version)
        binary = _library(component, texts, compiled_files(component, version), compiler)
        contents[f"binaries/{folder}/{component.name}{extension}"] = binary
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as zipped:
        for name, content in contents.items():
            zipped.writestr(zipfile.ZipInfo(name, _ENTRIES), content, zipfile.ZIP_DEFLATED)
    return buffer.getvalue(), compiler is not None


def sources(component: FmuComponent, version: int) -> dict[str, str]:
    """Return the C of an FMU by file name."""
    templates = resources.files("harness.realtime.export").joinpath("templates")
    names = ("fmi_instance.h", f"fmi{version}.h", f"fmi{version}.c")
    texts = {name: templates.joinpath(name).read_text(encoding="utf-8") for name in names}
    texts[f"fmi{version}.c"] = texts[f"fmi{version}.c"].replace("@TITLE@", component.title)
    return {**component.files, "fmi_model.h": component.model_header, **texts}


def binary_place(version: int) -> tuple[str, str]:
    """Return what FMI calls this machine's binaries, and how their names end.

    Raises:
        UserError: If FMI has no name for it.
    """
    system, extension = next((each[1:] for each in _SYSTEMS if sys.platform.startswith(each[0])), ("", ""))
    architecture = _ARCHITECTURES.get(platform.machine().lower(), "")
    if not system or not architecture:
        raise UserError(
            f"FMI has no name for binaries of {sys.platform} on {platform.machine()}; export the folder of C"
        )
    bits = "32" if architecture == "x86" else "64"
    return (f"{_SHORT[system]}{bits}" if version == 2 else f"{architecture}-{system}"), extension


_SYSTEMS = (("win", "windows", ".dll"), ("linux", "linux", ".so"), ("darwin", "darwin", ".dylib"))
_SHORT = {"windows": "win", "linux": "linux", "darwin": "darwin"}
_ARCHITECTURES = {
    "x86_64": "x86_64", "amd64": "x86_64", "i386": "x86", "i686": "x86", "aarch64": "aarch64", "arm64": "aarch64",
}  # fmt: skip


def _library(component: FmuComponent, texts: Mapping[str, str], files: list[str], compiler: str) -> bytes:
    """Return the bytes of the library."""
    with tempfile.TemporaryDirectory() as place:
        write_files(Path(place), texts)
        flags = [*FLAGS.split(), "-O2", "-shared", "-fPIC", "-fvisibility=hidden"]
        done = subprocess.run(
            [compiler, *flags, *files, "-o", component.name, "-lm"],
            cwd=place, capture_output=True, text=True, errors="replace", check=False,
        )  # fmt: skip
        if done.returncode:
            said = " ".join(done.stderr.split())[-300:]
            raise UserError(f"{compiler} cannot compile the FMU: {said}")
        return (Path(place) / component.name).read_bytes()
