"""The imports, read from the source: nothing points up, and each heavy library stays in its home."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FILES = sorted((ROOT / 'portnav_ros').rglob('*.py'))

LAYERS = (
    {'__init__', 'kernel_cache'},
    {'geometry', 'types', 'params', 'declarations', 'resources', 'findings'},
    {'harbour', 'charts', 'chart_features', 'nav2_map', 'vessel'},
    {'planning', 'control'},
    {'safety'},
    {'sim'},
    {'task'},
    {'training'},
    {'muzero', 'baselines'},
    {'evaluation'},
    {'nodes'},
    {'cli', 'doctor', 'training_command', 'average_command', '__main__'},
)
HEIGHT = {name: height for height, names in enumerate(LAYERS) for name in names}
HOMES = {
    'rclpy': ('nodes/',),
    'ompl': ('planning/',),
    'matplotlib': ('evaluation/plots',),
    'torch': (
        'muzero/',
        'baselines/ppo_agent',
        'baselines/ppo.py',
        'training/device',
        'training/run_directory',
    ),
    'stable_baselines3': ('baselines/ppo_agent', 'baselines/ppo_env'),
    'ray': ('muzero/distributed',),
}
MESSAGES = {'builtin_interfaces', 'rcl_interfaces'}


def imported_names(file: Path) -> list[str]:
    """Every module that a file imports, inside functions too; `from a import b` counts as a.b."""
    names = []
    for node in ast.walk(ast.parse(file.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'{file}: relative import'
            names += [f'{node.module}.{alias.name}' for alias in node.names]
    return names


def unit(file: Path) -> str:
    """The subpackage or top-level module that a file belongs to."""
    return file.relative_to(ROOT / 'portnav_ros').parts[0].removesuffix('.py')


def home_of(library: str) -> tuple[str, ...] | None:
    if library in MESSAGES or library.endswith('_msgs'):
        return HOMES['rclpy']
    return HOMES.get(library)


def name_of(file: Path) -> str:
    return str(file.relative_to(ROOT / 'portnav_ros'))


def files_of(name: str) -> list[Path]:
    """The files of this package that importing `name` runs; the last part may be something in a module."""
    parts = name.split('.')
    places = [ROOT.joinpath(*parts[:count]) for count in (len(parts) - 1, len(parts))]
    made = [file for place in places for file in (place.with_suffix('.py'), place / '__init__.py')]
    return [file for file in made if parts[0] == 'portnav_ros' and file.exists()]


def reached_from(file: Path) -> set[Path]:
    """A file and all of this package that it imports, and they import."""
    seen, new = {file}, [file]
    while new:
        found = {other for name in imported_names(new.pop()) for other in files_of(name)}
        new += found - seen
        seen |= found
    return seen


@pytest.mark.parametrize('file', FILES, ids=name_of)
def test_no_import_points_up(file):
    assert unit(file) in HEIGHT, f'{name_of(file)} has no layer: give it one here'
    for name in imported_names(file):
        parts = name.split('.')
        if parts[0] != 'portnav_ros':
            continue
        target = parts[1] if parts[1] in HEIGHT else '__init__'
        assert HEIGHT[target] <= HEIGHT[unit(file)], f'{name_of(file)} imports {name} from a layer above'


@pytest.mark.parametrize('file', FILES, ids=name_of)
def test_heavy_libraries_stay_at_home(file):
    for name in imported_names(file):
        home = home_of(name.partition('.')[0])
        if home:
            assert name_of(file).startswith(home), f'{name_of(file)} imports {name}, which lives in {home}'


@pytest.mark.parametrize('node', ['muzero_planner', 'ppo_planner'])
def test_a_node_that_runs_a_model_loads_no_training(node):
    reached = reached_from(ROOT / 'portnav_ros' / 'nodes' / f'{node}.py')
    assert ROOT / 'portnav_ros' / 'muzero' / 'model_file.py' in reached
    libraries = {name.partition('.')[0] for file in reached for name in imported_names(file)}
    assert not libraries & {'torch', 'gymnasium', 'stable_baselines3', 'pyproj', 'matplotlib'}
