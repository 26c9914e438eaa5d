"""Processes that behave and misbehave, run by the supervisor: small scripts that stand in for nodes."""

import os
import signal
import subprocess
import sys
import textwrap

import pytest

from portnav_ros.nodes.process import Command
from portnav_ros.nodes.supervisor import Limits, NodeDiedError, NotReadyError, StopRequest, Supervisor
from portnav_ros.nodes.table import OnDeath

LIMITS = Limits(ready_s=20.0, notice_s=20.0, interrupt_s=0.3, terminate_s=0.3, restarts=2, back_off_s=0.01)
MARK = 'PORTNAV_TEST_MARK'
READY = 'from portnav_ros.nodes.status_pipe import report, report_ready\nimport os, signal, time\n'
WAIT = READY + 'report_ready()\nsignal.pause()'
DEAF = (
    READY + 'for n in (2, 15): signal.signal(n, lambda *_: None)\nreport_ready()\nwhile True: signal.pause()'
)
CRASH = READY + 'report_ready()\nprint("out of luck", flush=True)\nos._exit(7)'
FINISH = READY + 'report_ready()\nreport(outcome="SUCCESS")'


def command(tmp_path, name, script, **kwargs) -> Command:
    return Command(name, (sys.executable, '-c', script), tmp_path / f'{name}.log', **kwargs)


def environment(mark: str) -> dict[str, str]:
    return dict(os.environ) | {MARK: mark}


def follow(supervisor: Supervisor, signal_number: int = 0) -> None:
    supervisor.wait_ready()
    os.kill(os.getpid(), signal_number)
    for _ in range(20):
        supervisor.poll(1.0)


def test_processes_get_ready_and_leave_nothing_behind(tmp_path, marked):
    commands = [command(tmp_path, name, WAIT) for name in ('one', 'two')]
    with Supervisor(commands, environment('calm'), print, LIMITS) as supervisor:
        reports = supervisor.wait_ready()
        assert {report.node for report in reports} == {'one', 'two'}
        assert len(marked('calm')) == 2
    assert not marked('calm')


def test_reports_arrive_before_a_good_end(tmp_path):
    commands = [command(tmp_path, 'sim', FINISH, finishes=True)]
    with Supervisor(commands, environment('end'), print, LIMITS) as supervisor:
        reports = supervisor.wait_ready()
        while not any(report.finished for report in reports):
            reports += supervisor.poll(5.0)
    assert {'outcome': 'SUCCESS'} in [report.values for report in reports]


def test_a_death_names_node_code_and_last_words(tmp_path, marked):
    commands = [command(tmp_path, 'pid', CRASH)]
    with (
        pytest.raises(NodeDiedError, match=r'(?s)pid ended with code 7.*pid\.log.*out of luck'),
        Supervisor(commands, environment('crash'), print, LIMITS) as supervisor,
    ):
        follow(supervisor)
    assert not marked('crash')


def test_a_death_while_starting_is_not_retried(tmp_path):
    commands = [command(tmp_path, 'pid', 'raise SystemExit("no model")', on_death=OnDeath.RESTART)]
    with (
        pytest.raises(NodeDiedError, match=r'(?s)while starting.*no model'),
        Supervisor(commands, environment('early'), print, LIMITS) as supervisor,
    ):
        supervisor.wait_ready()


def test_restarts_are_bounded(tmp_path):
    said: list[str] = []
    commands = [command(tmp_path, 'planner', CRASH, on_death=OnDeath.RESTART)]
    with (
        pytest.raises(NodeDiedError, match='death 3'),
        Supervisor(commands, environment('again'), said.append, LIMITS) as supervisor,
    ):
        follow(supervisor)
    assert [line.split('(')[1] for line in said] == ['restart 1 of 2)', 'restart 2 of 2)']


def test_a_death_after_a_long_life_is_the_first(tmp_path):
    said: list[str] = []
    commands = [command(tmp_path, 'planner', CRASH, on_death=OnDeath.RESTART)]
    with Supervisor(commands, environment('old'), said.append, LIMITS._replace(forgiven_s=0.0)) as supervisor:
        while len(said) < 4:
            supervisor.poll(0.05)
    assert {line.split('(')[1] for line in said} == {'restart 1 of 2)'}


def test_the_rest_runs_on_without_a_node_that_may_die(tmp_path, marked):
    said: list[str] = []
    commands = [
        command(tmp_path, 'recorder', CRASH, on_death=OnDeath.GO_ON),
        command(tmp_path, 'sim', WAIT),
    ]
    with Supervisor(commands, environment('on'), said.append, LIMITS) as supervisor:
        supervisor.wait_ready()
        while not said:
            supervisor.poll(0.05)
        assert len(marked('on')) == 1
    assert 'runs on without' in said[0]


def test_one_that_is_never_ready_is_named(tmp_path):
    commands = [command(tmp_path, 'slow', 'import signal; signal.pause()')]
    limits = LIMITS._replace(ready_s=0.2, notice_s=0.0)
    said: list[str] = []
    with (
        pytest.raises(NotReadyError, match='slow is not ready'),
        Supervisor(commands, environment('slow'), said.append, limits) as supervisor,
    ):
        supervisor.wait_ready()
    assert 'waiting for slow' in said[0]


def test_one_that_will_not_end_is_killed(tmp_path, marked):
    said: list[str] = []
    with Supervisor(
        [command(tmp_path, 'deaf', DEAF)], environment('deaf'), said.append, LIMITS
    ) as supervisor:
        supervisor.wait_ready()
    assert [line.split(': ')[1] for line in said] == ['SIGTERM', 'SIGKILL']
    assert not marked('deaf')


def test_what_a_process_has_started_ends_with_it(tmp_path, marked):
    script = READY + 'import subprocess\nsubprocess.Popen(["sleep", "1000"])\nreport_ready()\nos._exit(7)'
    with (
        pytest.raises(NodeDiedError),
        Supervisor([command(tmp_path, 'parent', script)], environment('kin'), print, LIMITS) as supervisor,
    ):
        follow(supervisor)
    assert not marked('kin')


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_wait(tmp_path, number, marked):
    before = signal.getsignal(number)
    with (
        pytest.raises(StopRequest, match=number.name),
        Supervisor([command(tmp_path, 'one', WAIT)], environment('sig'), print, LIMITS) as supervisor,
    ):
        follow(supervisor, number)
    assert signal.getsignal(number) is before
    assert not marked('sig')


def test_the_recorder_is_stopped_after_the_others(tmp_path):
    note = READY + textwrap.dedent("""
        def stop(number, frame):
            open('{}', 'a').write('{} ')
            os._exit(0)
        signal.signal(signal.SIGINT, stop)
        report_ready()
        signal.pause()
        """)
    order = tmp_path / 'order'
    commands = [
        command(tmp_path, 'recorder', note.format(order, 'recorder'), stops_last=True),
        command(tmp_path, 'sim', note.format(order, 'sim')),
    ]
    with Supervisor(commands, environment('order'), print, LIMITS) as supervisor:
        supervisor.wait_ready()
    assert order.read_text() == 'sim recorder '


def test_no_orphan_after_the_supervisor_is_killed(tmp_path, marked):
    script = textwrap.dedent(f"""
        import os, sys
        from pathlib import Path
        from portnav_ros.nodes.process import Command
        from portnav_ros.nodes.supervisor import Supervisor
        command = Command('one', (sys.executable, '-c', {WAIT!r}), Path({str(tmp_path / 'one.log')!r}))
        with Supervisor([command], dict(os.environ), print, held_files=(int(sys.argv[1]),)) as supervisor:
            supervisor.wait_ready()
            os.kill(os.getpid(), 9)
        """)
    reader, writer = os.pipe()
    process = subprocess.Popen(
        (sys.executable, '-c', script, str(writer)), env=environment('killed'), pass_fds=(writer,)
    )
    os.close(writer)
    assert process.wait() == -signal.SIGKILL
    assert os.read(reader, 1) == b'', 'the guardian holds the file until all has ended'
    os.close(reader)
    assert not marked('killed')
