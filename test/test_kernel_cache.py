"""Compiled kernels: those of other sources are never taken, whoever the kernels in them call."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import portnav_ros
from portnav_ros.kernel_cache import PREFIX, UNUSED_S, VARIABLE, digest, keep_kernels

PACKAGE = Path(portnav_ros.__file__).parent
INNER = 'from numba import njit\n\n@njit(cache=True)\ndef inner():\n    return {value}\n'
OUTER = (
    'from numba import njit\nfrom portnav_ros.inner import inner\nfrom portnav_ros.limits import LIMIT\n\n'
    '@njit(cache=True)\ndef outer():\n    return inner() + LIMIT\n'
)


@pytest.fixture
def package(tmp_path):
    """A package whose kernel calls one of another file and has a constant of a third."""
    folder = tmp_path / 'portnav_ros'
    folder.mkdir()
    for name in ('__init__.py', 'kernel_cache.py'):
        (folder / name).write_text((PACKAGE / name).read_text())
    (folder / 'inner.py').write_text(INNER.format(value=1))
    (folder / 'limits.py').write_text('LIMIT = 10\n')
    (folder / 'outer.py').write_text(OUTER)
    (folder / 'other.py').write_text('NAME = 1\n')
    return folder


def outer(package):
    """What a new process says of `outer()`."""
    environment = {name: value for name, value in os.environ.items() if name != VARIABLE}
    code = 'import numba; from portnav_ros.outer import outer; print(outer())'  # numba first, as users may
    run = subprocess.run(
        [sys.executable, '-c', code],
        cwd=package.parent,
        env=environment | {'PYTHONPATH': str(package.parent)},
        capture_output=True,
        text=True,
        check=True,
    )
    return int(run.stdout)


def kernels(package):
    return sorted(file.name for file in (package / '__pycache__').rglob('*.nbc'))


def test_a_change_elsewhere_reaches_the_kernel(package):
    assert outer(package) == 11
    assert len(kernels(package)) >= 1
    (package / 'inner.py').write_text(INNER.format(value=5))
    assert outer(package) == 15
    (package / 'limits.py').write_text('LIMIT = 20\n')
    assert outer(package) == 25


def test_what_is_the_same_is_not_compiled_again(package):
    outer(package)
    before = kernels(package)
    (package / 'other.py').write_text('NAME = 2\n')
    (package / 'inner.py').touch()
    first = digest(package)
    outer(package)
    assert digest(package) == first
    assert {name.split('.')[0] for name in kernels(package)} == {name.split('.')[0] for name in before}
    assert len(list((package / '__pycache__').glob(f'{PREFIX}*'))) == 1


def test_the_folder_is_below_the_one_that_is_chosen_also_in_a_process_of_ours(package, tmp_path):
    environment = {VARIABLE: str(tmp_path / 'mine')}
    keep_kernels(package, environment)
    folder = Path(environment[VARIABLE])
    assert folder.parent == tmp_path / 'mine'
    keep_kernels(package, environment)
    assert Path(environment[VARIABLE]) == folder


def test_a_package_that_cannot_be_written_has_its_kernels_in_the_users_cache(package, tmp_path, monkeypatch):
    (package / '__pycache__').write_text('no folder')
    environment = {'XDG_CACHE_HOME': str(tmp_path / 'cache')}
    keep_kernels(package, environment)
    assert Path(environment[VARIABLE]).parent == tmp_path / 'cache' / 'portnav_ros'
    (tmp_path / 'file').write_text('')
    nowhere = {VARIABLE: str(tmp_path / 'file')}
    keep_kernels(package, nowhere)
    assert nowhere == {VARIABLE: str(tmp_path / 'file')}


def test_the_lock_of_an_editor_is_no_source(package):
    before = digest(package)
    (package / '.#inner.py').symlink_to('somebody@somewhere')
    assert digest(package) == before


def test_without_a_place_all_stays_as_numba_has_it(package, monkeypatch):
    def nobody():
        raise RuntimeError('Could not determine home directory.')

    monkeypatch.setattr(Path, 'home', nobody)
    (package / '__pycache__').write_text('no folder')
    environment = {}
    keep_kernels(package, environment)
    assert environment == {}


def test_kernels_that_nobody_uses_any_more_are_removed(package, tmp_path):
    old, young, foreign = (tmp_path / name for name in (f'{PREFIX}old', f'{PREFIX}young', 'foreign'))
    for folder in (old, young, foreign):
        folder.mkdir()
    for folder in (old, foreign):
        os.utime(folder, (0.0, 0.0))
    assert UNUSED_S > 0.0
    keep_kernels(package, {VARIABLE: str(tmp_path)})
    assert (old.exists(), young.exists(), foreign.exists()) == (False, True, True)


def test_this_package_is_cached_by_its_sources():
    assert Path(os.environ[VARIABLE]).name == f'{PREFIX}{digest(PACKAGE)}'
