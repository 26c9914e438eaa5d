import json
import math
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from portnav_ros.evaluation.plots import inline_svg
from portnav_ros.evaluation.plots_port import port_figure, view_box
from portnav_ros.evaluation.plots_series import series_figure
from portnav_ros.evaluation.replay import MAX_ROWS, MAX_SCANS, replay_data
from portnav_ros.evaluation.report import headline, rerun_command, write_report
from portnav_ros.types import Outcome


class Page(HTMLParser):
    """Collects what a page refers to, and checks that its elements close."""

    VOID = frozenset({'meta', 'input', 'br', 'link', 'img'})

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag, attributes):
        for name, value in attributes:
            if name in ('src', 'href', 'xlink:href') and not value.startswith('#'):
                self.links.append(value)
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        pass

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_a_report_is_one_page_that_needs_nothing_else(straight, tmp_path):
    page = write_report(straight(metadata={'version': '1 < 2'}), tmp_path / 'new')
    assert page == tmp_path / 'new' / 'report.html'
    assert sorted(file.name for file in page.parent.iterdir()) == ['port.png', 'report.html', 'summary.json']
    text = page.read_text()
    parser = Page()
    parser.feed(text)
    assert parser.open == []
    assert parser.links == []
    assert not re.search(r'url\((?!#)', text)
    assert '1 &lt; 2' in text
    assert text.count('<svg') == 2
    assert (page.parent / 'port.png').read_bytes().startswith(b'\x89PNG')


def test_the_summary_holds_outcome_and_figures(straight, tmp_path):
    write_report(straight(3.0), tmp_path)
    values = json.loads((tmp_path / 'summary.json').read_text())
    assert values['outcome'] == 'success'
    assert values['abs_e_y_m'] == pytest.approx(3.0)
    assert (values['planner'], values['difficulty'], values['seed']) == ('dwa', 'easy', 7)


def test_the_headline_tells_the_outcome(straight):
    assert headline(straight()) == (
        'The dwa planner reached its goal after 1:40 min; it came no closer than 50.0 m to another vessel.'
    )
    assert headline(straight(outcome=Outcome.COLLISION_BUOY)) == 'The dwa planner hit a buoy after 1:40 min.'


def test_the_command_that_repeats_the_episode(straight):
    assert rerun_command(straight()) == 'portnav demo --seed 7 --difficulty easy --planner dwa'
    options = json.dumps({'scenario': 'head_on', 'difficulty': 'easy', 'chart': None, 'planner': 'dwa'})
    assert '--scenario head_on' in rerun_command(straight(metadata={'options': options}))


def test_a_damaged_recording_is_announced(straight, tmp_path):
    page = write_report(straight(metadata={'lost': 'the last minute'}), tmp_path)
    assert 'The recording is damaged: the last minute.' in page.read_text()


def test_a_bare_recording_still_gives_a_report(straight, tmp_path):
    log = straight(clearance=None, targets=(), scans=None, latency_s=np.zeros(0), outcome=Outcome.RUNNING)
    assert 'still under way' in write_report(log, tmp_path).read_text()


def test_replay_data_is_json_of_bounded_size(straight):
    log = straight(period_s=0.02, clearance=None)
    data = replay_data(log)
    json.dumps(data, allow_nan=False)
    assert len(data['time_s']) <= MAX_ROWS
    assert len(data['own']) == len(data['time_s']) == len(data['targets'][0]['pose'])
    assert len(data['scans']['time_s']) <= MAX_SCANS
    assert data['scans']['ranges_dm'][0][0] == 900


def test_rays_without_a_return_are_not_drawn(straight):
    log = straight()
    log.scans.ranges[0, :3] = (np.inf, -np.inf, np.nan)
    assert replay_data(log)['scans']['ranges_dm'][0][:3] == [0, 0, 0]


def test_the_picture_holds_track_and_plan(straight):
    log = straight()
    x_min, y_min, x_max, y_max = view_box(log)
    assert x_min < log.own[:, 0].min()
    assert x_max > log.path[:, 0].max()
    assert (x_max - x_min) / (y_max - y_min) <= 4.0 + 1e-9
    assert math.isclose(0.5 * (y_min + y_max), 0.0, abs_tol=1e-9)


@pytest.mark.parametrize('outcome', list(Outcome))
def test_every_outcome_can_be_drawn(straight, outcome):
    log = straight(outcome=outcome)
    assert len(port_figure(log).axes) == (3 if outcome.collision else 2)


def test_pictures_are_the_same_for_the_same_log_and_follow_the_page(straight):
    first, second = (inline_svg(series_figure(straight())) for _ in range(2))
    assert first == second
    assert first.startswith('<svg')
    assert 'currentColor' in first
