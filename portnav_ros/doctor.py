"""``portnav doctor``: look at an installation, or at running nodes, and say what to mend.

The first works with whatever is missing.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.metadata
import importlib.util
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from portnav_ros import __version__
from portnav_ros.findings import Finding, show
from portnav_ros.params import ParamError
from portnav_ros.resources import config_path, model_path

LIBRARIES = {
    'numpy': 'numpy',
    'numba': 'numba',
    'scipy': 'scipy',
    'shapely': 'shapely',
    'pyproj': 'pyproj',
    'yaml': 'pyyaml',
    'gymnasium': 'gymnasium',
    'ompl': 'ompl',
    'rosbags': 'rosbags',
    'matplotlib': 'matplotlib',
    'tqdm': 'tqdm',
    'PIL': 'pillow',
    'safetensors': 'safetensors',
}
DISTRO = 'jazzy'
MIDDLEWARE = 'rmw_fastrtps_cpp'
LOOPBACK_TIMEOUT_S = 30.0
LISTEN_S = 4.0
SHARED_MEMORY_LEAST_MB = 32
DOMAIN_ID_SAFE, DOMAIN_ID_MOST = 101, 232
DISCOVERY_RANGES = ('LOCALHOST', 'SUBNET', 'OFF', 'SYSTEM_DEFAULT')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare --json and --graph."""
    parser.add_argument(
        '--graph',
        nargs='?',
        const=LISTEN_S,
        type=float,
        metavar='SECONDS',
        help='look at the nodes that run instead: listen (default: %(const)s s; in less, some may be missed) '
        'and say what is wrong',
    )
    parser.add_argument(
        '--json', nargs='?', const='-', metavar='FILE', help='write JSON to FILE (or standard output)'
    )


def run(arguments: argparse.Namespace) -> int:
    """Print one line per check; returns 1 if any failed, else 0."""
    if arguments.graph is not None:
        graph_doctor = importlib.import_module('portnav_ros.nodes.graph_doctor')  # needs ROS
        return show(graph_doctor.examine(arguments.graph, os.environ), 'all is well', arguments.json)
    return show(examine(os.environ), 'ready to sail', arguments.json)


def examine(environment: Mapping[str, str]) -> list[Finding]:
    """Make all checks; the environment is an argument so that tests can set it."""
    return [
        check_python(sys.version_info[:2]),
        *(check_library(module, name) for module, name in LIBRARIES.items()),
        check_data(config_path),
        *check_models(model_path),
        check_kernel_cache(Path(__file__).parent, environment),
        check_ros_distro(environment),
        check_domain(environment),
        check_discovery(environment),
        check_shared_memory(Path('/dev/shm')),
        check_loopback(environment),
        check_torch(),
    ]


def check_python(version: tuple[int, int]) -> Finding:
    """3.11 and 3.12 have wheels of every library."""
    found = f'{version[0]}.{version[1]} ({sys.executable}), portnav_ros {__version__}'
    if version < (3, 11):
        return Finding('python', 'fail', found, 'install Python 3.11 or 3.12 and make a new environment')
    if version > (3, 12):
        return Finding('python', 'warn', found, 'tested on 3.11 and 3.12; the ROS wheels exist for these')
    return Finding('python', 'ok', found)


def check_library(module: str, name: str) -> Finding:
    """Import a required library."""
    try:
        importlib.import_module(module)
        return Finding(name, 'ok', importlib.metadata.version(name))
    except Exception as error:  # a broken binary wheel raises anything
        return Finding(name, 'fail', str(error), f'pip install -c constraints.txt {name}')


def check_data(find: Callable[..., Path]) -> Finding:
    """The configuration files came with the package."""
    try:
        return Finding('data files', 'ok', str(find('difficulties').parent))
    except ParamError as error:
        return Finding('data files', 'fail', str(error), 'install the package again, or clone all of it')


def check_models(find: Callable[..., Path]) -> list[Finding]:
    """Released models are there and whole, and this version can sail with them."""
    mend = 'clone all of it, or train one with `portnav train`; the other planners need none'
    try:
        folder = find()
    except ParamError as error:
        return [Finding('model', 'warn', str(error), mend)]
    files = sorted(folder.glob('*.safetensors'))
    return [check_model(file) for file in files] or [Finding('model', 'warn', f'none in {folder}', mend)]


def check_model(file: Path) -> Finding:
    """Weights and card belong together and make a policy for the sensor they were trained with."""
    check = f'model {file.stem}'
    try:
        from portnav_ros.baselines.ppo_policy import PpoPolicy  # a library may be missing
        from portnav_ros.muzero.model_file import load_model
        from portnav_ros.muzero.policy import MuZeroPolicy

        model = load_model(file)
        make = MuZeroPolicy if model.card.algorithm == 'muzero' else PpoPolicy
        make(model, model.card.lidar)
    except Exception as error:  # a broken binary wheel raises anything
        mend = (
            f'take {file.name} and its card again from a clone of this version, once the libraries are there'
        )
        return Finding(check, 'fail', str(error), mend)
    card = model.card
    return Finding(check, 'ok', f'{card.algorithm} for {card.vessel.name}, sha256 {model.sha256[:12]}')


def check_kernel_cache(package: Path, environment: Mapping[str, str]) -> Finding:
    """Compiled kernels are kept, so that only the first start waits for the compiler."""
    chosen = environment.get('NUMBA_CACHE_DIR')  # which the package has set where it found a place
    folders = [Path(chosen)] if chosen else [package, Path.home()]
    for folder in folders:
        if os.access(folder, os.W_OK):
            return Finding('kernel cache', 'ok', f'{folder} is writable')
    mend = 'set NUMBA_CACHE_DIR to a folder that you can write, else every start compiles for half a minute'
    return Finding('kernel cache', 'warn', f'{folders[0]} cannot be written', mend)


def check_ros_distro(environment: Mapping[str, str]) -> Finding:
    """One ROS at a time, and Jazzy."""
    distro = environment.get('ROS_DISTRO')
    from_wheels = _has_distribution('ros-jazzy-rclpy')
    if distro and distro != DISTRO:
        return Finding('ros', 'fail', f'ROS_DISTRO={distro}', f'source ROS 2 {DISTRO}, in a new shell')
    if distro and from_wheels:
        mend = 'use one of them: a shell that does not source setup.bash, or an environment without the extra'
        return Finding('ros', 'warn', f'{distro} is sourced, and the ros wheels are installed', mend)
    if distro or from_wheels:
        return Finding('ros', 'ok', f'{distro} (sourced)' if distro else f'{DISTRO} (wheels)')
    mend = "pip install -c constraints.txt '.[ros]', or source a full ROS 2 Jazzy; evaluation needs neither"
    return Finding('ros', 'warn', 'no ROS: no nodes', mend)


def check_domain(environment: Mapping[str, str]) -> Finding:
    """A domain whose ports do not meet those the system hands out."""
    text = environment.get('ROS_DOMAIN_ID') or '0'
    found, mend = f'ROS_DOMAIN_ID={text}', f'set a number from 0 to {DOMAIN_ID_SAFE}'
    if not text.isdecimal() or int(text) > DOMAIN_ID_MOST:
        return Finding('domain', 'fail', found, mend)
    if int(text) > DOMAIN_ID_SAFE:
        return Finding('domain', 'warn', f'{found}: its ports may be taken by others', mend)
    return Finding('domain', 'ok', found)


def check_discovery(environment: Mapping[str, str]) -> Finding:
    """Who may find the nodes."""
    chosen = environment.get('ROS_AUTOMATIC_DISCOVERY_RANGE', 'unset (portnav up and demo take LOCALHOST)')
    found = f'ROS_AUTOMATIC_DISCOVERY_RANGE={chosen}' if ' ' not in chosen else chosen
    if ' ' not in chosen and chosen not in DISCOVERY_RANGES:
        return Finding('discovery', 'fail', found, f'set it to one of {", ".join(DISCOVERY_RANGES)}')
    if chosen == 'OFF':
        return Finding('discovery', 'fail', found, 'nodes cannot find each other: set it to LOCALHOST')
    return Finding('discovery', 'ok', found)


def check_shared_memory(folder: Path) -> Finding:
    """Fast DDS sends within one machine through here."""
    if not folder.is_dir():
        return Finding('shared memory', 'warn', f'no {folder}', 'Fast DDS takes UDP: slower, but it works')
    free_mb = shutil.disk_usage(folder).free // 2**20
    if free_mb < SHARED_MEMORY_LEAST_MB:
        mend = f'remove stale {folder}/fastrtps_* while no node runs; in Docker: --shm-size=256m'
        return Finding('shared memory', 'warn', f'{free_mb} MB free in {folder}', mend)
    return Finding('shared memory', 'ok', f'{free_mb} MB free in {folder}')


def check_loopback(environment: Mapping[str, str]) -> Finding:
    """Two participants find each other, in a process of its own, which may hang or crash."""
    if importlib.util.find_spec('rclpy') is None:
        return Finding('round trip', 'warn', 'not tried: no rclpy', 'see `ros` above')
    try:
        result = _run_loopback(environment)
    except subprocess.TimeoutExpired:
        return _no_loopback(f'hung for {LOOPBACK_TIMEOUT_S:.0f} s')
    if result.returncode != 0:
        return _no_loopback(_last_line(result.stderr) or f'exit code {result.returncode}')
    answer = json.loads(_last_line(result.stdout))
    found = f'first message after {1000.0 * answer["elapsed_s"]:.0f} ms through {answer["rmw"]}'
    if answer['rmw'] != MIDDLEWARE:
        return Finding('round trip', 'warn', found, f'tested with RMW_IMPLEMENTATION={MIDDLEWARE} only')
    return Finding('round trip', 'ok', found)


def check_torch() -> Finding:
    """Only training needs it."""
    if _has_distribution('torch'):
        return Finding('torch', 'ok', importlib.metadata.version('torch'))
    return Finding('torch', 'ok', 'not installed; only training needs it (extra `train`)')


def _run_loopback(environment: Mapping[str, str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, '-m', 'portnav_ros.nodes.loopback'],
        env={'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', **environment},
        capture_output=True,
        text=True,
        timeout=LOOPBACK_TIMEOUT_S,
    )


def _no_loopback(found: str) -> Finding:
    mend = 'unset RMW_IMPLEMENTATION and FASTRTPS_DEFAULT_PROFILES_FILE; try another ROS_DOMAIN_ID'
    return Finding('round trip', 'fail', found, mend)


def _has_distribution(name: str) -> bool:
    try:
        importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


def _last_line(text: str) -> str:
    lines = text.strip().splitlines()
    return lines[-1] if lines else ''
