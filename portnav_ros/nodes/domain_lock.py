"""One graph for each ROS domain and namespace: a second one would answer the first one's messages."""

from __future__ import annotations

import fcntl
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path

DOMAIN_MOST = 232  # beyond it, DDS runs out of ports


class DomainBusyError(RuntimeError):
    """Another graph runs on this domain; the message says which process and what to do."""


class DomainError(ValueError):
    """ROS_DOMAIN_ID is no domain."""


def read_domain(environment: Mapping[str, str]) -> int:
    """ROS domain of an environment, 0 where none is set.

    Raises:
        DomainError: it is not a number that DDS has ports for.
    """
    text = environment.get('ROS_DOMAIN_ID') or '0'
    if not text.isdecimal() or int(text) > DOMAIN_MOST:
        raise DomainError(f'ROS_DOMAIN_ID={text}: set a number from 0 to 101')
    return int(text)


def hold_domain(domain: int, namespace: str, folder: Path | None = None) -> int:
    """Lock a domain for as long as the returned descriptor, or a copy of it, stays open.

    Args:
        domain: ROS_DOMAIN_ID.
        namespace: of the nodes, '' for none.
        folder: of the lock files, by default the user's runtime directory.

    Raises:
        DomainBusyError: another process holds it.
    """
    folder = folder or _runtime_folder()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    name = namespace.strip('/').replace('/', '.')
    descriptor = os.open(folder / f'domain-{domain}-{name}.lock', os.O_RDWR | os.O_CREAT, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        holder = os.read(descriptor, 32).decode() or 'unknown'
        os.close(descriptor)
        raise DomainBusyError(
            f'another portnav graph runs on ROS domain {domain} (process {holder}); end it, '
            'or choose another domain: ROS_DOMAIN_ID=N portnav ..., N in 0 to 101'
        ) from None
    os.truncate(descriptor, 0)
    os.pwrite(descriptor, str(os.getpid()).encode(), 0)
    return descriptor


def _runtime_folder() -> Path:
    runtime = os.environ.get('XDG_RUNTIME_DIR')
    return Path(runtime) / 'portnav' if runtime else Path(tempfile.gettempdir()) / f'portnav-{os.getuid()}'
