"""One graph for each domain and namespace."""

import os

import pytest

from portnav_ros.nodes.domain_lock import DomainBusyError, DomainError, hold_domain, read_domain


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


def test_a_domain_is_read_from_the_environment():
    assert [read_domain(env) for env in ({}, {'ROS_DOMAIN_ID': ''}, {'ROS_DOMAIN_ID': '7'})] == [0, 0, 7]


@pytest.mark.parametrize('text', ['port', '-1', '233'])
def test_what_is_no_domain_is_refused(text):
    with pytest.raises(DomainError, match=f'ROS_DOMAIN_ID={text}: set a number'):
        read_domain({'ROS_DOMAIN_ID': text})
