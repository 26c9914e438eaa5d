import sys
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = 'portnav_ros'
README = Path(__file__).resolve().with_name('README.md')  # colcon --symlink-install links setup.py alone
EXECUTABLES = (
    'bag_recorder',
    'pid_controller',
    'safety_monitor',
    'muzero_planner',
    'dwa_planner',
    'ppo_planner',
    'line_of_sight_planner',
    'global_planner',
    'sim',
)
REQUIREMENTS = [
    'numpy',
    'numba',
    'scipy',
    'shapely',
    'pyproj',
    'pyyaml',
    'gymnasium',
    'ompl',
    'rosbags',
    'matplotlib',
    'tqdm',
    'pillow',
    'safetensors',
]
EXTRAS = {
    'ros': ['ros-jazzy-rclpy[fastrtps]', 'ros-jazzy-common-interfaces'],
    'train': ['torch>=2.8', 'stable-baselines3', 'tensorboard'],
    'peers': ['mctx', 'jax'],
    'test': ['pytest', 'hypothesis', 'ruff', 'mypy', 'colcon-common-extensions', 'setuptools<80'],
}


def data_files():
    """Config, examples, models and launch files go to share/portnav_ros, in a wheel as under colcon."""
    share = Path('share', PACKAGE)
    index = Path('share/ament_index/resource_index/packages')
    files = {index: [Path('resource', PACKAGE)], share: [Path('package.xml')]}
    for folder in ('config', 'examples', 'launch', 'models'):
        for file in sorted(path for path in Path(folder).rglob('*') if path.is_file()):
            if '__pycache__' not in file.parts:
                files.setdefault(share / file.parent, []).append(file)
    return [(str(folder), [str(file) for file in names]) for folder, names in files.items()]


def console_scripts():
    """`ros2 run` wants one script per node in lib/portnav_ros, where setup.cfg sends all scripts.

    Only colcon and the Debian tools run this file with `install` or `develop`. pip asks the build
    backend for a wheel, whose scripts land in bin/: there `sim` would be in everybody's way.
    """
    scripts = ['portnav = portnav_ros.cli:main']
    if {'install', 'develop'} & set(sys.argv[1:]):
        scripts += [f'{name} = portnav_ros.nodes.{name}:main' for name in EXECUTABLES]
    return scripts


setup(
    name=PACKAGE,
    version='0.1.0',
    description='Autonomous port navigation with ranging sensors: world, planners and ROS 2 nodes.',
    long_description=README.read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    author='portnav_ros contributors',
    maintainer='portnav_ros contributors',
    maintainer_email='portnav@users.noreply.github.com',
    license='Apache-2.0',
    python_requires='>=3.11',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={PACKAGE: ['py.typed', 'evaluation/page/*']},
    data_files=data_files(),
    install_requires=REQUIREMENTS,
    extras_require=EXTRAS,
    entry_points={'console_scripts': console_scripts()},
    zip_safe=False,
)
