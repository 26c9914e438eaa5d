"""Where compiled kernels are kept: in a folder for each state of their sources.

Numba compares a kernel with the file that defines it, and with none of those whose kernels and constants it
uses: after a change of one of these the world would go on with the physics of before.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import sys
import time
from collections.abc import Iterator, MutableMapping
from contextlib import suppress
from pathlib import Path

VARIABLE = 'NUMBA_CACHE_DIR'
PREFIX = 'portnav_kernels_'
UNUSED_S = 7 * 24 * 3600.0  # after which the kernels of another state are removed
_IMPORTED = re.compile(rb'^from portnav_ros\.([\w.]+) import', re.MULTILINE)


def keep_kernels(package: Path, environment: MutableMapping[str, str]) -> None:
    """Tell numba, by NUMBA_CACHE_DIR, where kernels of the package as it stands are kept.

    That is below a folder that the variable names already, beside the package, or in the user's cache folder.
    Where none can be written all stays as numba has it.
    """
    for parent in _parents(package, environment):
        folder = parent / f'{PREFIX}{digest(package)}'
        try:
            folder.mkdir(parents=True, exist_ok=True)
            os.utime(folder)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            environment[VARIABLE] = str(folder)
            if environment is os.environ and (numba := sys.modules.get('numba')):  # has read it by now
                numba.config.CACHE_DIR = str(folder)
            _remove_unused(parent)
            return


def digest(package: Path) -> str:
    """Hash of the files that hold kernels, and of those that they import from."""
    content = {file: file.read_bytes() for file in package.rglob('*.py') if file.is_file()}
    sources = {file for file, text in content.items() if b'njit' in text}
    for file in list(sources):
        names = (name.decode().split('.') for name in _IMPORTED.findall(content[file]))
        sources |= {package.joinpath(*name).with_suffix('.py') for name in names} & content.keys()
    found = hashlib.sha256()
    for file in sorted(sources):
        text = content[file]
        found.update(f'{file.relative_to(package)} {len(text)}\n'.encode() + text)
    return found.hexdigest()[:16]


def _parents(package: Path, environment: MutableMapping[str, str]) -> Iterator[Path]:
    if chosen := environment.get(VARIABLE):
        folder = Path(chosen)  # one of ours where a process of ours has started this one
        yield folder.parent if folder.name.startswith(PREFIX) else folder
        return
    yield package / '__pycache__'
    if cache := environment.get('XDG_CACHE_HOME'):
        yield Path(cache) / 'portnav_ros'
        return
    with suppress(RuntimeError):  # nobody's home, as in a container under a number that is no user's
        yield Path.home() / '.cache' / 'portnav_ros'


def _remove_unused(parent: Path) -> None:
    for folder in parent.glob(f'{PREFIX}*'):
        try:
            unused_s = time.time() - folder.stat().st_mtime
        except OSError:
            continue  # another process has removed it
        if unused_s > UNUSED_S:
            shutil.rmtree(folder, ignore_errors=True)
