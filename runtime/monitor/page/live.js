'use strict';
// Asks the service for what is new and draws it. No network beyond this machine.

const kKept = 2000, kPlotted = 200, kPoll_ms = 500;
const kMetresPerDegree = 111320;
const kSigmas95 = 2.448;  // of a two-dimensional Gaussian
const kStatusColour = {fix: '#1a7f37', degraded: '#c98a00', no_fix: '#b42318'};
const kStageColour = {wait: '#9aa4b1', decode: '#5b8def', preprocess: '#7a5bef', features: '#2a9d8f',
  retrieval: '#e9c46a', matching: '#f4a261', pose: '#e76f51'};
const byId = id => document.getElementById(id);

let trail = [], bundleId = null, chosen = null;
let map = null, routeLayer = null, trailLayer = null, ellipse = null, chosenMark = null;

function makeMap() {
  if (typeof L === 'undefined') {
    byId('map').textContent = 'No map: install libjs-leaflet where the service runs.';
    return;
  }
  map = L.map('map', {preferCanvas: true, attributionControl: false, maxZoom: 24, zoomSnap: 0.25});
  map.setView([0, 0], 2);
  L.control.scale({imperial: false}).addTo(map);
  routeLayer = L.layerGroup().addTo(map);
  trailLayer = L.layerGroup().addTo(map);
  map.on('dragstart', () => { byId('follow').checked = false; });
}

async function loadRoute() {
  const route = await (await fetch('api/route')).json();
  bundleId = route.id;
  if (!map) return;
  routeLayer.clearLayers();
  const at = route.panoramas;
  for (const [a, b] of route.links) {
    L.polyline([at[a], at[b]], {color: '#8aa0b8', weight: 3, interactive: false}).addTo(routeLayer);
  }
  for (const p of at) {
    L.circleMarker(p, {radius: 2, color: '#5c7089', interactive: false}).addTo(routeLayer);
  }
  if (at.length) map.fitBounds(L.latLngBounds(at).pad(0.1), {maxZoom: 20});
}

function ellipseOf(point) {
  const [long_m, short_m, turn_deg] = point.sigma, [lat, lon] = point.at;
  const turn = turn_deg * Math.PI / 180, corners = [];
  for (let i = 0; i < 48; ++i) {
    const a = i * Math.PI / 24;
    const u = kSigmas95 * long_m * Math.cos(a), v = kSigmas95 * short_m * Math.sin(a);
    const north = u * Math.cos(turn) - v * Math.sin(turn);
    const east = u * Math.sin(turn) + v * Math.cos(turn);
    corners.push([lat + north / kMetresPerDegree,
      lon + east / (kMetresPerDegree * Math.cos(lat * Math.PI / 180))]);
  }
  return corners;
}

function addMark(point) {
  if (!map || !point.at) return;
  point.mark = L.circleMarker(point.at.slice(0, 2), {radius: 4, weight: 1,
    color: kStatusColour[point.status], fillOpacity: 0.8}).addTo(trailLayer);
  point.mark.on('click', () => { choose(point); });
}

function choose(point) {
  chosen = point;
  byId('follow').checked = false;
  show(point);
}

function show(point) {
  const rows = [['answer', point.n], ['time, ns', point.timestamp_ns], ['status', point.status]];
  if (point.reason) rows.push(['reason', point.reason]);
  if (point.at) {
    rows.push(['latitude', point.at[0].toFixed(7)], ['longitude', point.at[1].toFixed(7)],
      ['height, m', point.at[2].toFixed(2)], ['heading, deg', point.heading_deg.toFixed(2)],
      ['sigma, m', point.sigma[0].toFixed(3) + ' by ' + point.sigma[1].toFixed(3)]);
  }
  rows.push(['inliers', point.inliers], ['panorama', point.panorama],
    ['latency, ms', point.ms.total.toFixed(1)]);
  const table = byId('detail');
  table.replaceChildren(...rows.map(([name, value]) => {
    const row = document.createElement('tr');
    for (const text of [name, value]) row.insertCell().textContent = text;
    return row;
  }));
  table.dataset.answer = point.n;
  if (!map) return;
  for (const layer of [ellipse, chosenMark]) if (layer) layer.remove();
  ellipse = chosenMark = null;
  if (!point.at) return;
  ellipse = L.polygon(ellipseOf(point), {color: '#2563eb', weight: 1, interactive: false}).addTo(map);
  chosenMark = L.circleMarker(point.at.slice(0, 2), {radius: 8, color: '#2563eb', fill: false,
    interactive: false}).addTo(map);
}

function sharpCanvas(canvas) {
  const ratio = window.devicePixelRatio || 1, box = canvas.getBoundingClientRect();
  canvas.width = box.width * ratio;
  canvas.height = box.height * ratio;
  const context = canvas.getContext('2d');
  context.scale(ratio, ratio);
  return [context, box.width, box.height];
}

function plotLatency(points) {
  const [context, width, height] = sharpCanvas(byId('latency'));
  const most = Math.max(1, ...points.map(p => p.ms.total)) * 1.05, step = width / kPlotted;
  points.forEach((p, i) => {
    let y = height;
    for (const stage of Object.keys(kStageColour)) {
      const h = p.ms[stage] / most * height;
      context.fillStyle = kStageColour[stage];
      context.fillRect(i * step, y -= h, Math.max(step - 0.5, 0.5), h);
    }
  });
  context.fillStyle = getComputedStyle(document.body).color;
  context.fillText(most.toFixed(0) + ' ms', 2, 10);
}

function plotStatus(points) {
  const [context, width, height] = sharpCanvas(byId('status')), step = width / kPlotted;
  points.forEach((p, i) => {
    context.fillStyle = kStatusColour[p.status];
    context.fillRect(i * step, 0, Math.max(step - 0.5, 0.5), height);
  });
}

// The frame on the left, on the right the view of the map that shows most of it: a map has no
// pictures, so its landmarks. Lines join what agrees with the pose.
function drawSight(image, sight) {
  const canvas = byId('sight'), [w, h] = sight.size, gap = w / 50, x0 = w + gap;
  const dot = Math.max(2, w / 200);
  canvas.width = 2 * w + gap;
  canvas.height = h;
  const context = canvas.getContext('2d');
  if (image) context.drawImage(image, 0, 0, w, h);
  context.fillStyle = '#10151c';
  context.fillRect(x0, 0, w, h);
  context.fillStyle = '#8aa0b8';
  for (const [x, y] of sight.landmarks) {
    context.fillRect(x0 + x - dot / 2, y - dot / 2, dot, dot);
  }
  context.lineWidth = w / 500;
  sight.pairs.forEach(([fx, fy, vx, vy], i) => {
    context.strokeStyle = `hsl(${i * 137.5 % 360} 85% 60%)`;
    context.globalAlpha = 0.35;
    context.beginPath();
    context.moveTo(fx, fy);
    context.lineTo(x0 + vx, vy);
    context.stroke();
    context.globalAlpha = 1;
    for (const [x, y] of [[fx, fy], [x0 + vx, vy]]) {
      context.beginPath();
      context.arc(x, y, w / 130, 0, 2 * Math.PI);
      context.stroke();
    }
  });
}

async function showPicture() {
  const answer = await fetch('api/frame');
  const sight = await (await fetch('api/sight')).json();
  const time_ns = answer.headers.get('X-Timestamp-Ns'), image = byId('frame'), old = image.src;
  const hasPicture = answer.status === 200;
  // Of the same frame, unless a newer one came in between.
  const hasSight = sight !== null && sight.timestamp_ns === time_ns;
  if (!hasPicture && !hasSight) return;
  const blob = hasPicture ? await answer.blob() : null;
  if (hasPicture) {
    image.src = URL.createObjectURL(blob);
    if (old) URL.revokeObjectURL(old);
  }
  image.hidden = !hasPicture || hasSight;
  byId('sight').hidden = !hasSight;
  byId('frame-note').textContent = 'newest frame';
  if (!hasSight) return;
  drawSight(hasPicture ? await createImageBitmap(blob) : null, sight);
  byId('frame-note').textContent = `newest frame, and landmarks of the view that shows most of it ` +
    `(${sight.from_panorama_m.toFixed(1)} m from panorama ${sight.panorama}); lines: ` +
    `${sight.pairs.length} keypoints that agree with the pose`;
}

function showHeader(live) {
  const last = trail[trail.length - 1], state = byId('state'), c = live.counts, b = live.bundle;
  state.className = last ? last.status : '';
  state.textContent = last ? last.status + (last.reason ? ': ' + last.reason : '') : 'waiting for frames';
  byId('map-name').textContent =
    `${b.name}, build ${b.build}${b.is_signed ? '' : ', unsigned'} (${b.id.slice(0, 12)})`;
  byId('counts').textContent = `${c.answers} answers, ${c.fixes} fixes, ${c.replaced} frames ` +
    `replaced by newer ones, ${c.refused} refused, ${c.disconnects} disconnects`;
}

async function poll() {
  try {
    const last = trail.length ? trail[trail.length - 1].n : 0;
    const live = await (await fetch('api/live?after=' + last)).json();
    // A service that was started anew counts from one.
    if (live.counts.answers < last) { location.reload(); return; }
    if (live.bundle.id !== bundleId) await loadRoute();
    for (const point of live.trail) { addMark(point); trail.push(point); }
    for (const gone of trail.splice(0, Math.max(0, trail.length - kKept))) {
      if (gone.mark) gone.mark.remove();
    }
    showHeader(live);
    if (live.trail.length) {
      const newest = trail[trail.length - 1], plotted = trail.slice(-kPlotted);
      if (byId('follow').checked) {
        show(newest);
        if (map && newest.at) map.panTo(newest.at.slice(0, 2), {animate: false});
      }
      plotLatency(plotted);
      plotStatus(plotted);
      await showPicture();
    }
  } catch (error) {
    byId('state').className = 'gone';
    byId('state').textContent = 'service does not answer';
  }
  setTimeout(poll, kPoll_ms);
}

byId('legend').replaceChildren(...Object.entries(kStageColour).map(([stage, colour]) => {
  const item = document.createElement('span'), box = document.createElement('i');
  box.style.background = colour;
  item.append(box, stage);
  return item;
}));
byId('follow').addEventListener('change', () => { chosen = null; });
makeMap();
poll();
