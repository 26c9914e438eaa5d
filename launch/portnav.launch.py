"""The graph for a full ROS installation: ``ros2 launch portnav_ros portnav.launch.py planner:=dwa``.

Takes the options of ``portnav up``, reads the same table of nodes and the same configuration, and hands the
processes to launch.
"""

from pathlib import Path

import yaml
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch_ros.actions import Node

from portnav_ros.nodes.bringup import default_folder
from portnav_ros.nodes.preparation import (
    PARAMETERS,
    GraphOptions,
    load,
    make_options,
    prepare,
    read_configuration,
)
from portnav_ros.nodes.process import Command
from portnav_ros.nodes.table import NodeSpec, OnDeath

PACKAGE = 'portnav_ros'
MONITOR = 'safety_monitor'
RETRIES = 3  # of a node that has died
OPTIONS = {
    'planner': 'local planner: dwa, line_of_sight, muzero or ppo',
    'model': 'of a learned planner: its weights',
    'allow_mismatch': 'true: sail another vessel than the model was trained for',
    'difficulty': 'paper, harbour, easy or a YAML file',
    'scenario': 'a named scenario or its YAML file',
    'chart': 'GeoJSON or nav2 map YAML',
    'seed': 'of port, traffic and planner',
    'mode': 'lock_step or real_time',
    'rate': 'times real time, e.g. 4.0',
    'record': 'true or false',
    'storage': 'of the bag: sqlite3 or mcap',
    'namespace': 'of every node',
    'without': 'nodes to leave out, e.g. "[sim]" beside a real vessel',
}
FILES = {'config': 'YAML: only what differs', 'out': 'folder for bag and parameters'}


def generate_launch_description() -> LaunchDescription:
    """Declare the options; what they mean is known only when launch has read them."""
    arguments = [
        DeclareLaunchArgument(name, default_value='', description=text)
        for name, text in {**OPTIONS, **FILES}.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=_start)])


def _start(context: LaunchContext) -> list[Node]:
    text = context.launch_configurations
    config = Path(text['config']) if text['config'] else None
    configuration = read_configuration(config)
    given = {name: yaml.safe_load(text[name]) for name in OPTIONS if text[name]}
    options = make_options(configuration, str(config or 'config/portnav.yaml'), {}, given)
    out = Path(text['out'] or default_folder(options.seed))
    commands = prepare(options, configuration, load(options), out)
    return [_node(spec, command, options, out) for spec, command in zip(options.nodes, commands, strict=True)]


def _node(spec: NodeSpec, command: Command, options: GraphOptions, out: Path) -> Node:
    # without a manager nobody would tell a new safety monitor that the vessel has been stopped
    restart = command.on_death is OnDeath.RESTART and spec.name != MONITOR
    ends = not restart and command.on_death is not OnDeath.GO_ON
    return Node(
        package=PACKAGE,
        executable=spec.name,
        name=spec.name,
        namespace=options.namespace,
        parameters=[str((out / PARAMETERS).resolve())],
        output='screen',
        ros_arguments=[part for remap in options.remaps for part in ('-r', remap)],
        respawn=restart,
        respawn_delay=1.0 if restart else None,
        respawn_max_retries=RETRIES,
        on_exit=Shutdown(reason=f'{spec.name} has ended') if ends else None,
    )
