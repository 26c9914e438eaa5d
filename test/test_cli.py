import os
import subprocess
import sys
import types
import warnings

import pytest

import portnav_ros
from portnav_ros import cli
from portnav_ros.params import ParamError


@pytest.fixture
def fake(monkeypatch):
    """Make `portnav demo` call a function given by the test."""

    def install(run, add_arguments=lambda parser: None):
        module = types.SimpleNamespace(add_arguments=add_arguments, run=run)
        monkeypatch.setitem(sys.modules, 'portnav_ros.nodes.demo', module)

    return install


def failing(error):
    def run(arguments):
        raise error

    return run


def test_help_lists_every_command(capsys):
    with pytest.raises(SystemExit) as ending:
        cli.main(['--help'])
    assert ending.value.code == 0
    text = capsys.readouterr().out
    assert all(f'  {name} ' in text for name in cli.COMMANDS)


FIRST_NUMPY = """
import os, sys
from portnav_ros import cli

class Watch:
    def find_spec(self, name, *_):
        if name == 'numpy':
            print('BLAS has', os.environ.get('OPENBLAS_NUM_THREADS'))

assert 'numpy' not in sys.modules
sys.meta_path.insert(0, Watch())
cli.main(['{command}', '--help'])
"""


@pytest.mark.parametrize('command', ['train', 'benchmark'])
@pytest.mark.parametrize(('asked', 'threads'), [({}, 1), ({'OPENBLAS_NUM_THREADS': '3'}, 3)])
def test_blas_has_one_thread_unless_asked(command, asked, threads):
    others = {name: value for name, value in os.environ.items() if not name.endswith('_NUM_THREADS')}
    script = FIRST_NUMPY.format(command=command)
    done = subprocess.run([sys.executable, '-c', script], env=others | asked, capture_output=True, text=True)
    assert f'BLAS has {threads}\n' in done.stdout, done.stderr


def test_version(capsys):
    with pytest.raises(SystemExit) as ending:
        cli.main(['--version'])
    assert ending.value.code == 0
    assert portnav_ros.__version__ in capsys.readouterr().out


@pytest.mark.parametrize('arguments', [[], ['sail']])
def test_unknown_command_is_refused(arguments, capsys):
    with pytest.raises(SystemExit) as ending:
        cli.main(arguments)
    assert ending.value.code == 2
    assert 'portnav: error' in capsys.readouterr().err


@pytest.mark.parametrize('command', cli.COMMANDS)
def test_every_command_explains_itself(command, capsys):
    with pytest.raises(SystemExit) as ending:
        cli.main([command, '--help'])
    assert ending.value.code == 0
    assert f'usage: portnav {command}' in capsys.readouterr().out


def test_help_imports_no_library():
    code = (
        'import sys; from portnav_ros import cli\n'
        'try: cli.main(["--help"])\n'
        'except SystemExit: pass\n'
        'sys.exit(", ".join({"numpy", "numba", "rclpy", "yaml", "matplotlib"} & set(sys.modules)) or 0)'
    )
    result = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr


def test_exit_code_and_arguments_pass_through(fake):
    fake(lambda arguments: arguments.seed, lambda parser: parser.add_argument('--seed', type=int))
    assert cli.main(['demo', '--seed', '7']) == 7


@pytest.mark.parametrize(
    ('error', 'message'),
    [
        (ParamError('a.yaml: unknown key'), 'a.yaml: unknown key'),
        (FileNotFoundError(2, 'No such file or directory', 'chart.geojson'), 'chart.geojson: No such file'),
        (ModuleNotFoundError("No module named 'rclpy'", name='rclpy'), 'portnav_ros[ros]'),
        (ModuleNotFoundError("No module named 'nav_msgs'", name='nav_msgs.msg'), 'portnav_ros[ros]'),
        (ModuleNotFoundError("No module named 'torch'", name='torch'), 'portnav_ros[train]'),
        (
            ModuleNotFoundError("No module named 'stable_baselines3'", name='stable_baselines3'),
            'portnav_ros[train]',
        ),
        (ModuleNotFoundError("No module named 'rosbags'", name='rosbags'), 'rosbags'),
    ],
)
def test_mistakes_of_the_user_get_one_line(fake, capsys, error, message):
    fake(failing(error))
    assert cli.main(['demo']) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith('portnav: error: ')
    assert message in captured.err
    assert captured.err.count('\n') == 1


@pytest.mark.parametrize('error', [ValueError('shape mismatch'), ModuleNotFoundError(name='portnav_ros.x')])
def test_a_defect_keeps_its_traceback(fake, error):
    fake(failing(error))
    with pytest.raises(type(error)):
        cli.main(['demo'])


def test_interrupt(fake):
    fake(failing(KeyboardInterrupt()))
    assert cli.main(['demo']) == 130


def test_run_hands_the_rest_of_the_line_to_the_node(monkeypatch):
    seen = []
    node = types.SimpleNamespace(main=lambda: seen.extend(sys.argv))
    monkeypatch.setitem(sys.modules, 'portnav_ros.nodes.sim', node)
    monkeypatch.setattr(sys, 'argv', ['portnav'])
    assert cli.main(['run', 'sim', '--ros-args', '-p', 'seed:=3']) == 0
    assert seen == ['sim', '--ros-args', '-p', 'seed:=3']


def test_run_tells_the_parameters_of_a_node(capsys):
    assert cli.main(['run', 'pid_controller', '--help']) == 0
    assert '`odom_age_s`' in capsys.readouterr().out


def test_run_refuses_an_unknown_node(capsys):
    with pytest.raises(SystemExit):
        cli.main(['run', 'simulator'])
    assert 'pid_controller' in capsys.readouterr().err


def test_a_warning_is_one_line(fake, capsys):
    fake(lambda arguments: warnings.warn('a buoy lies on land', stacklevel=1) or 0)
    with warnings.catch_warnings():
        warnings.simplefilter('always')
        assert cli.main(['demo']) == 0
    assert capsys.readouterr().err == 'portnav: warning: a buoy lies on land\n'
