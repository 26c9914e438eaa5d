'use strict';
(() => {
  const data = JSON.parse(document.getElementById('data').textContent);
  const find = (id) => document.getElementById(id);
  const canvas = find('chart'), slider = find('slider'), readout = find('readout'), play = find('play');
  const paint = canvas.getContext('2d');
  const colours = {
    water: '#eaf2f6', shore: '#6b665c', plan: '#0072b2', goal: '#009e73', own: '#1b2733', sailed: '#de4968',
    other: '#7a4f9a', buoy: '#b8860b', uncharted: '#d55e00', scan: '#d55e00',
  };
  const times = data.time_s, last = times.length - 1;
  const view = { x: 0, y: 0, scale: 1 };
  let now = times[0], playing = false, before = 0;
  slider.min = times[0];
  slider.max = times[last];

  function resize() {
    const ratio = window.devicePixelRatio || 1;
    canvas.width = canvas.clientWidth * ratio;
    canvas.height = canvas.clientHeight * ratio;
    draw();
  }

  function fit() {
    const [x0, y0, x1, y1] = data.box;
    view.x = (x0 + x1) / 2;
    view.y = (y0 + y1) / 2;
    view.scale = Math.min(canvas.clientWidth / (x1 - x0), canvas.clientHeight / (y1 - y0));
    draw();
  }

  function rowBefore(values, t) {
    let low = 0, high = values.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (values[middle] <= t) low = middle; else high = middle - 1;
    }
    return low;
  }

  function turn(from, to, share) {
    const difference = ((to - from + Math.PI) % (2 * Math.PI) + 2 * Math.PI) % (2 * Math.PI) - Math.PI;
    return from + share * difference;
  }

  function poseAt(track, row, share) {
    const a = track[row], b = track[Math.min(row + 1, track.length - 1)];
    if (!a || !b) return null;
    return [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), turn(a[2], b[2], share)];
  }

  function trace(points, close) {
    paint.beginPath();
    points.forEach(([x, y], k) => (k ? paint.lineTo(x, y) : paint.moveTo(x, y)));
    if (close) paint.closePath();
  }

  function hull(pose, length, beam, fill) {
    paint.save();
    paint.translate(pose[0], pose[1]);
    paint.rotate(pose[2]);
    const bow = length / 2, side = beam / 2, shoulder = bow - Math.min(beam, 0.3 * length);
    trace([[bow, 0], [shoulder, side], [-bow, side], [-bow, -side], [shoulder, -side]], true);
    paint.fillStyle = fill;
    paint.fill();
    trace([[bow, side], [-bow, side], [-bow, -side], [bow, -side]], true);
    paint.lineWidth = 1 / view.scale;
    paint.strokeStyle = fill;
    paint.stroke();
    paint.restore();
  }

  function disc(x, y, radius, fill) {
    paint.beginPath();
    paint.arc(x, y, Math.max(radius, 2.5 / view.scale), 0, 2 * Math.PI);
    paint.fillStyle = fill;
    paint.fill();
  }

  function drawChart() {
    paint.beginPath();
    for (const ring of data.water) {
      ring.forEach(([x, y], k) => (k ? paint.lineTo(x, y) : paint.moveTo(x, y)));
      paint.closePath();
    }
    paint.fillStyle = colours.water;
    paint.fill('evenodd');
    paint.strokeStyle = colours.shore;
    paint.lineWidth = 1 / view.scale;
    paint.stroke();
    for (const [x, y, radius, charted] of data.buoys) {
      disc(x, y, radius, charted ? colours.buoy : colours.uncharted);
    }
    paint.globalAlpha = 0.2;
    disc(data.goal[0], data.goal[1], data.goal_radius_m, colours.goal);
    paint.globalAlpha = 1;
    trace(data.plans[rowBefore(data.plans.map(([time]) => time), now)][1], false);
    paint.strokeStyle = colours.plan;
    paint.setLineDash([8 / view.scale, 5 / view.scale]);
    paint.lineWidth = 1.5 / view.scale;
    paint.stroke();
    paint.setLineDash([]);
  }

  function drawScan(row, share) {
    if (!data.scans || !find('scan').checked) return;
    const index = rowBefore(data.scans.time_s, now);
    if (Math.abs(now - data.scans.time_s[index]) > 2.5) return;
    const at = rowBefore(times, data.scans.time_s[index]);
    const [x, y, yaw] = data.own[at], [ahead, left, turned] = data.scans.mounting;
    const from = [
      x + ahead * Math.cos(yaw) - left * Math.sin(yaw), y + ahead * Math.sin(yaw) + left * Math.cos(yaw),
    ];
    data.scans.ranges_dm[index].forEach((range, k) => {
      if (!range) return;
      const angle = yaw + turned + data.scans.angle_min_rad + k * data.scans.angle_increment_rad;
      disc(from[0] + 0.1 * range * Math.cos(angle), from[1] + 0.1 * range * Math.sin(angle), 0, colours.scan);
    });
  }

  function describe(row) {
    const seconds = Math.round(now - times[0]), [, , yaw, speed, rudder] = data.own[row];
    const clock = `${Math.floor(seconds / 60)}:${String(seconds % 60).padStart(2, '0')}`;
    const heading = ((90 - yaw * 180 / Math.PI) % 360 + 360) % 360;
    readout.textContent = `${clock}   ${speed.toFixed(1)} m/s   heading ${heading.toFixed(0).padStart(3, '0')}°` +
      (rudder === null ? '' : `   rudder ${(rudder * 180 / Math.PI).toFixed(0)}°`) + (now >= times[last] ? `   ${data.outcome}` : '');
  }

  function draw() {
    const row = rowBefore(times, now), next = Math.min(row + 1, last);
    const share = next > row ? Math.min((now - times[row]) / (times[next] - times[row]), 1) : 0;
    const own = poseAt(data.own, row, share);
    if (find('follow').checked) [view.x, view.y] = own;
    const ratio = window.devicePixelRatio || 1;
    paint.setTransform(1, 0, 0, 1, 0, 0);
    paint.clearRect(0, 0, canvas.width, canvas.height);
    paint.setTransform(ratio * view.scale, 0, 0, -ratio * view.scale,
      canvas.width / 2 - ratio * view.scale * view.x, canvas.height / 2 + ratio * view.scale * view.y);
    drawChart();
    trace(data.own.slice(0, row + 1).concat([own]), false);
    paint.strokeStyle = colours.sailed;
    paint.lineWidth = 2 / view.scale;
    paint.stroke();
    for (const target of data.targets) {
      const pose = poseAt(target.pose, row, share);
      if (pose) hull(pose, target.length_m, target.beam_m, colours.other);
    }
    drawScan(row, share);
    hull(own, data.hull[0], data.hull[1], colours.own);
    describe(row);
    slider.value = now;
  }

  function setPlaying(on) {
    playing = on;
    play.textContent = on ? 'Pause' : 'Play';
    if (!on) return;
    if (now >= times[last]) now = times[0];
    before = performance.now();
    requestAnimationFrame(frame);
  }

  function frame(stamp) {
    if (!playing) return;
    now = Math.min(now + Math.max(stamp - before, 0) / 1000 * Number(find('rate').value), times[last]);
    before = stamp;
    draw();
    if (now >= times[last]) setPlaying(false); else requestAnimationFrame(frame);
  }

  function step(seconds) {
    now = Math.min(Math.max(now + seconds, times[0]), times[last]);
    draw();
  }

  play.addEventListener('click', () => setPlaying(!playing));
  slider.addEventListener('input', () => { now = Number(slider.value); draw(); });
  find('fit').addEventListener('click', () => { find('follow').checked = false; fit(); });
  for (const id of ['follow', 'scan']) find(id).addEventListener('change', draw);
  canvas.addEventListener('keydown', (event) => {
    if (event.key === ' ') setPlaying(!playing);
    else if (event.key === 'ArrowRight') step(1);
    else if (event.key === 'ArrowLeft') step(-1);
    else return;
    event.preventDefault();
  });
  canvas.addEventListener('wheel', (event) => {
    event.preventDefault();
    const factor = Math.exp(-event.deltaY * 0.0015);
    const dx = (event.offsetX - canvas.clientWidth / 2) / view.scale;
    const dy = -(event.offsetY - canvas.clientHeight / 2) / view.scale;
    view.x += dx * (1 - 1 / factor);
    view.y += dy * (1 - 1 / factor);
    view.scale *= factor;
    draw();
  }, { passive: false });
  canvas.addEventListener('pointermove', (event) => {
    if (!(event.buttons & 1)) return;
    find('follow').checked = false;
    view.x -= event.movementX / view.scale;
    view.y += event.movementY / view.scale;
    draw();
  });
  canvas.addEventListener('pointerdown', (event) => canvas.setPointerCapture(event.pointerId));
  window.addEventListener('resize', resize);
  resize();
  fit();
})();
