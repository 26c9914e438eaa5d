"""Where a figure comes from: command, version, commit and machine."""

from __future__ import annotations

import os
import platform
import shlex
import subprocess
import sys
from pathlib import Path

from portnav_ros import __version__
from portnav_ros.resources import share_directory


def provenance() -> dict[str, str]:
    """Command line, version and git commit of this very code."""
    return {'command': command_line(), 'version': __version__, 'git_commit': git_commit()}


def command_line() -> str:
    """Return the command that this process runs, as one would type it."""
    name = Path(sys.argv[0]).name
    return shlex.join(['portnav' if name in ('portnav', '__main__.py') else name, *sys.argv[1:]])


def git_commit() -> str:
    """Commit of the checkout that the code runs from; 'unknown' for an installed package."""
    folder = share_directory()
    if not (folder / '.git').exists():
        return 'unknown'
    try:
        shown = subprocess.run(
            ['git', 'describe', '--always', '--dirty', '--abbrev=12', '--exclude=*'],
            cwd=folder,
            capture_output=True,
            text=True,
            check=True,
            timeout=10.0,
        )
    except (OSError, subprocess.SubprocessError):
        return 'unknown'
    return shown.stdout.strip()


def machine() -> dict[str, str]:
    """Processor, cores, Python and system."""
    return {
        'processor': _processor(),
        'cores': str(len(os.sched_getaffinity(0))),
        'python': platform.python_version(),
        'system': platform.platform(terse=True),
    }


def _processor() -> str:
    try:
        lines = Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(':')[2].strip() for line in lines if line.startswith('model name')]
    return names[0] if names else platform.machine()
