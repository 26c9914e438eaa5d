"""One graph for each domain and namespace."""

import os

import pytest

from portnav_ros.nodes.domain_lock import DomainBusyError, hold_domain


def test_a_second_graph_on_the_domain_is_refused(tmp_path):
    held = hold_domain(50, '', tmp_path)
    with pytest.raises(DomainBusyError, match=rf'domain 50 \(process {os.getpid()}\).*ROS_DOMAIN_ID'):
        hold_domain(50, '', tmp_path)
    os.close(held)
    os.close(hold_domain(50, '', tmp_path))


def test_domains_and_namespaces_do_not_bother_each_other(tmp_path):
    held = [hold_domain(*key, tmp_path) for key in ((50, ''), (51, ''), (50, '/tug/one'), (50, 'tug'))]
    for descriptor in held:
        os.close(descriptor)


def test_a_copy_of_the_descriptor_holds_on(tmp_path):
    held = hold_domain(50, '', tmp_path)
    copy = os.dup(held)
    os.close(held)
    with pytest.raises(DomainBusyError):
        hold_domain(50, '', tmp_path)
    os.close(copy)
