import json
import math
import re
from argparse import Namespace
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from portnav_ros.evaluation import report
from portnav_ros.evaluation.episode_log import PlanLog
from portnav_ros.evaluation.plots import inline_svg
from portnav_ros.evaluation.plots_port import port_figure, view_box
from portnav_ros.evaluation.plots_series import series_figure
from portnav_ros.evaluation.replay import MAX_ROWS, MAX_SCANS, replay_data
from portnav_ros.evaluation.report import headline, write_report
from portnav_ros.safety.mounting import Mounting
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


def test_notes_tell_what_to_know_of_the_figures(straight, tmp_path):
    log = straight()
    log = straight(
        earlier_plans=(PlanLog(0.0, log.path[:30]),),
        path_since_s=50.0,
        targets=(log.targets[0]._replace(length_m=0.0, beam_m=0.0),),
    )
    page = write_report(log, tmp_path).read_text()
    assert 'The plan changed 1 time, and led to another goal before' in page
    assert '1 of the other vessels are of unknown size' in page
    (first, _), (second, _) = replay_data(log)['plans']
    assert (first, second) == (0.0, 50.0)


def test_actuators_that_nobody_recorded_are_not_drawn(straight, tmp_path):
    log = straight(own=straight().own + np.array([0.0] * 5 + [np.nan] * 2))
    assert replay_data(log)['own'][0][4] is None
    assert (
        json.loads((write_report(log, tmp_path).parent / 'summary.json').read_text())['control_effort']
        is None
    )


def test_scans_are_drawn_where_the_sensor_is(straight):
    log = straight()
    mounted = straight(scans=log.scans._replace(mounting=Mounting(40.0, 0.0, 1.5)))
    assert replay_data(log)['scans']['mounting'] == [0.0, 0.0, 0.0]
    assert replay_data(mounted)['scans']['mounting'] == [40.0, 0.0, 1.5]


def test_the_legend_names_what_is_there(straight):
    def names(log):
        return {text.get_text() for text in port_figure(log).axes[0].get_legend().get_texts()}

    log = straight()
    hidden = replace(log.harbour, charted=np.zeros(len(log.harbour.buoys), bool))
    assert {'buoy', 'buoy not on the chart'} <= names(log)
    assert 'buoy' not in names(straight(harbour=hidden))


def test_a_report_lies_in_the_folder_that_is_named(straight, tmp_path, monkeypatch, capsys):
    (tmp_path / 'bag-2').mkdir()
    monkeypatch.setattr(report, 'read_episode', lambda path: straight())
    for folder in (tmp_path, tmp_path / 'bag-2'):
        assert report.run(Namespace(bag=folder, out=None)) == 0
        assert (folder / 'report.html').exists()
    assert f'portnav report {tmp_path / "bag-2"}' in capsys.readouterr().out


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
