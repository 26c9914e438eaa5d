"""Processes are found by who started them and by their environment."""

import os
import subprocess
import sys

from portnav_ros.evaluation.processes import family, marked, process_name, read_usage

MARK = 'PORTNAV_TEST_MARK'


def test_a_child_is_found_while_it_lives():
    value = str(os.getpid())
    words = (sys.executable, '-c', 'print(flush=True); input()', 'portnav_ros.nodes.sim')
    environment = os.environ | {MARK: value}
    child = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment)
    child.stdout.readline()
    assert marked(MARK, value) == [child.pid]
    assert child.pid in family(os.getpid())
    assert process_name(child.pid) == 'sim'
    assert read_usage(child.pid).rss_mb > 1.0
    child.communicate(b'\n')
    assert not marked(MARK, value)
    assert read_usage(child.pid) is None
