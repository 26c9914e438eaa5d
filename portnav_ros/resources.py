"""Files that come with the package: configuration and released models."""

from __future__ import annotations

from pathlib import Path

from portnav_ros.params import ParamError

PACKAGE = 'portnav_ros'


def config_path(*parts: str) -> Path:
    """Find a file or folder below config/.

    Raises:
        ParamError: it is not there; the message names the folder and what it holds.
    """
    return _find('config', *parts)


def model_path(*parts: str) -> Path:
    """Find a file or folder below models/.

    Raises:
        ParamError: it is not there; the message names the folder and what it holds.
    """
    return _find('models', *parts)


def share_directory(module_file: Path = Path(__file__)) -> Path:
    """Folder that holds config/: the checkout, or share/portnav_ros of the prefix of this very code.

    The nearest one above the package wins, so that code never reads the data of another version,
    as it could through AMENT_PREFIX_PATH with two overlays.

    Raises:
        ParamError: neither is there.
    """
    package = module_file.resolve().parent
    for parent in package.parents:
        checkout, share = parent, parent / 'share' / PACKAGE
        if package.parent == checkout and (checkout / 'package.xml').is_file():
            return checkout
        if share.is_dir():
            return share
    raise ParamError(f'{package}: no share/{PACKAGE} beside this installation; install the package again')


def _find(*parts: str) -> Path:
    path = share_directory().joinpath(*parts)
    if path.exists():
        return path
    raise ParamError(f'{path}: no such file{_neighbours(path)}')


def _neighbours(path: Path) -> str:
    names = sorted(item.name for item in path.parent.glob('*'))
    return f'; {path.parent.name}/ holds {", ".join(names)}' if names else ''
