// Draws one instant of a run, of which page.html.j2 holds the data; lengths are in mm, angles of poses in rad.
"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const frames = data.time.length;
const last = data.time[frames - 1] || 1;
const element = (id) => document.getElementById(id);
const slider = element("slider");
slider.max = frames - 1;
const GRID = "#e4e4e4";

// A canvas in CSS pixels, cleared, however fine the screen is.
function cleared(id) {
  const canvas = element(id);
  const { clientWidth: width, clientHeight: height } = canvas;
  const scale = window.devicePixelRatio || 1;
  canvas.width = Math.round(width * scale);
  canvas.height = Math.round(height * scale);
  const pen = canvas.getContext("2d");
  pen.scale(scale, scale);
  pen.font = "13px system-ui, sans-serif";
  return { pen, width, height };
}

// Steps of 1, 2 or 5 times a power of ten that leave about so many of them in a range.
function ticks(low, high, count) {
  const raw = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [1, 2, 5, 10].find((each) => each * power >= raw);
  const found = [];
  for (let tick = Math.ceil(low / step); tick * step <= high; tick++) found.push(tick * step);
  return { found, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

// A line through points in pixels, with gaps at null.
function stroke(pen, points, colour, thick) {
  pen.beginPath();
  let down = false;
  for (const point of points) {
    if (point) pen[down ? "lineTo" : "moveTo"](...point);
    down = Boolean(point);
  }
  pen.strokeStyle = colour;
  pen.lineWidth = thick;
  pen.lineJoin = "round";
  pen.stroke();
}

// First and last index of each stretch of frames that share a value.
function stretches(values) {
  const starts = values.flatMap((value, index) => (index && value === values[index - 1] ? [] : [index]));
  return starts.map((first, place) => [first, (starts[place + 1] ?? values.length) - 1]);
}

function placed(pose, points) {
  const [x, y, theta] = pose;
  const [cos, sin] = [Math.cos(theta), Math.sin(theta)];
  return points.map(([px, py]) => [x + cos * px - sin * py, y + sin * px + cos * py]);
}

const CIRCLE = Array.from({ length: 65 }, (_, index) => (2 * Math.PI * index) / 64);

// The region that holds the object's origin with 95 % probability.
function ellipse(now) {
  const [[a, b], [c, d]] = data.halfAxes[now];
  const points = CIRCLE.map((angle) => [Math.cos(angle), Math.sin(angle)]);
  return placed(data.estimate[now], points.map(([x, y]) => [a * x + b * y, c * x + d * y]));
}

const bounds = (() => {
  const reach = Math.max(...data.outline.map(([x, y]) => Math.hypot(x, y)));
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  const add = (poses, margin) => poses.forEach((pose) => {
    if (!pose) return;
    box[0] = Math.min(box[0], pose[0] - margin);
    box[1] = Math.min(box[1], pose[1] - margin);
    box[2] = Math.max(box[2], pose[0] + margin);
    box[3] = Math.max(box[3], pose[1] + margin);
  });
  add(data.sensor, 10);
  add(data.estimate, reach + 5);
  add(data.truth, reach + 5);
  return box;
})();

function drawAbove(now) {
  const { pen, width, height } = cleared("above");
  const [left, bottom] = [36, 20];
  const [x0, y0, x1, y1] = bounds;
  const scale = Math.min((width - left) / (x1 - x0), (height - bottom) / (y1 - y0));
  const middle = [left + (width - left) / 2, (height - bottom) / 2];
  const at = ([x, y]) => [middle[0] + scale * (x - (x0 + x1) / 2), middle[1] - scale * (y - (y0 + y1) / 2)];
  const back = (px, py) => [(px - middle[0]) / scale + (x0 + x1) / 2, (y0 + y1) / 2 - (py - middle[1]) / scale];
  const [[lowX, highY], [highX, lowY]] = [back(left, 0), back(width, height - bottom)];
  pen.fillStyle = "#555";
  for (const [low, high, upright] of [[lowX, highX, true], [lowY, highY, false]]) {
    const { found, digits } = ticks(low, high, upright ? 6 : 5);
    for (const tick of found) {
      const [px, py] = at([tick, tick]);
      stroke(pen, upright ? [[px, 0], [px, height - bottom]] : [[left, py], [width, py]], GRID, 1);
      pen.textAlign = upright ? "center" : "right";
      if (upright && px > left + 12 && px < width - 12) pen.fillText(tick.toFixed(digits), px, height - 5);
      if (!upright && py > 8 && py < height - bottom - 4) pen.fillText(tick.toFixed(digits), left - 5, py + 4);
    }
  }
  pen.save();
  pen.beginPath();
  pen.rect(left, 0, width - left, height - bottom);
  pen.clip();
  const line = (points, colour, thick, fill) => {
    stroke(pen, points.map((point) => point && at(point)), colour, thick);
    if (fill) pen.fillStyle = fill, pen.fill();
  };
  const dot = ([x, y], colour, radius) => {
    pen.beginPath();
    pen.arc(...at([x, y]), radius, 0, 2 * Math.PI);
    pen.fillStyle = colour;
    pen.fill();
  };
  line(data.truth.slice(0, now + 1), COLOURS.truth, 3);
  line(data.estimate.slice(0, now + 1), COLOURS.estimate, 1.5);
  line(data.sensor.slice(0, now + 1), COLOURS.sensor + "66", 1);
  for (const pose of data.others[now] || []) line(placed(pose, data.outline), COLOURS.others, 1);
  if (data.truth[now]) line(placed(data.truth[now], data.outline), COLOURS.truth, 4, "#00000008");
  line(placed(data.estimate[now], data.outline), COLOURS.estimate, 1.75);
  line(ellipse(now), COLOURS.estimate, 1.25, COLOURS.estimate + "22");
  for (const pad of data.pads) {
    const points = placed(data.sensor[now], pad);
    line([...points, points[0]], COLOURS.sensor, 1.5, COLOURS.sensor + "33");
  }
  dot(data.sensor[now], COLOURS.sensor, 2);
  if (data.contact[now][0] !== null) dot(data.contact[now], COLOURS.contact, 4);
  pen.restore();
}

const LEFT = 44; // [px] beside the plots, for the numbers
const acrossOf = (width) => (time) => LEFT + ((width - LEFT - 8) * time) / last;

const drawCursor = (pen, x, height) => stroke(pen, [[x, 0], [x, height]], "#000", 1);

// The left edge and the width of a stretch of frames in pixels.
function span(across, [first, end]) {
  const from = across(data.time[first]);
  return [from, across(data.time[Math.min(end + 1, frames - 1)]) - from];
}

// Lines over time within a band; where a line is much lower than its band, the band is cut off.
function drawPlot(id, now, low, high, lines, bottom) {
  const { pen, width, height } = cleared(id);
  const across = acrossOf(width);
  const floor = height - 20;
  const known = lines.flatMap(([values]) => values).filter((value) => value !== null);
  const peak = Math.max(...known, 1e-9);
  const top = 1.08 * Math.max(peak, Math.min(Math.max(...high), 4 * peak));
  const up = (value) => floor - ((floor - 4) * (Math.min(value, top) - bottom)) / (top - bottom);
  pen.fillStyle = COLOURS.contact + "1f";
  for (const stretch of stretches(data.contact.map(([x]) => x !== null))) {
    const [from, wide] = span(across, stretch);
    if (data.contact[stretch[0]][0] !== null) pen.fillRect(from, 0, wide, floor);
  }
  pen.textAlign = "right";
  const marks = ticks(bottom, top, 4);
  for (const tick of marks.found) {
    stroke(pen, [[LEFT, up(tick)], [width, up(tick)]], GRID, 1);
    pen.fillStyle = "#555";
    pen.fillText(tick.toFixed(marks.digits), LEFT - 5, up(tick) + 4);
  }
  pen.textAlign = "center";
  const seconds = ticks(0, last, 6);
  seconds.found.forEach((tick, place) => {
    const words = tick.toFixed(seconds.digits) + (place ? "" : " s");
    if (across(tick) < width - 14) pen.fillText(words, across(tick), height - 4);
  });
  pen.beginPath();
  data.time.forEach((time, index) => pen[index ? "lineTo" : "moveTo"](across(time), up(high[index])));
  for (let index = frames - 1; index >= 0; index--) pen.lineTo(across(data.time[index]), up(low[index]));
  pen.fillStyle = COLOURS.estimate + "40";
  pen.fill();
  for (const [values, colour] of lines) {
    stroke(pen, values.map((value, index) => value !== null && [across(data.time[index]), up(value)]), colour, 1.5);
  }
  drawCursor(pen, across(data.time[now]), floor);
}

function drawError(id, now) {
  const { error, sigma } = data[id];
  const isKnown = error.some((value) => value !== null);
  drawPlot(id, now, sigma.map(() => 0), sigma, [isKnown ? [error, COLOURS.truth] : [sigma, COLOURS.estimate]], 0);
}

function drawFriction(now) {
  const { value, sigma } = data.friction;
  const [less, more] = [-1, 1].map((side) => value.map((each, index) => each + side * sigma[index]));
  drawPlot("friction", now, less, more, [[value, COLOURS.estimate]], Math.max(0, Math.min(...less) - 0.02));
}

function drawStatus(now) {
  const { pen, width, height } = cleared("status");
  const across = acrossOf(width);
  for (const stretch of stretches(data.status)) {
    const [from, wide] = span(across, stretch);
    pen.fillStyle = data.statusColours[data.status[stretch[0]]];
    pen.fillRect(from, 4, Math.max(1, wide), height - 8);
  }
  drawCursor(pen, across(data.time[now]), height);
}

// The picture is the last one at or before this instant.
function showPictures(now) {
  if (!data.pictures.length) return;
  const later = data.pictures.findIndex((each) => each.time > data.time[now] + 1e-6);
  const picture = data.pictures[later < 0 ? data.pictures.length - 1 : Math.max(0, later - 1)];
  for (const name of ["touch", "model"]) {
    element(name).style.visibility = picture[name] ? "visible" : "hidden";
    if (picture[name] && element(name).src !== picture[name]) element(name).src = picture[name];
  }
}

function show(now) {
  slider.value = now;
  element("time").textContent = data.time[now].toFixed(2) + " s";
  element("word").textContent = data.status[now];
  drawAbove(now);
  drawError("translation", now);
  drawError("rotation", now);
  drawFriction(now);
  drawStatus(now);
  showPictures(now);
}

let playing = null; // when it began [ms], and at what time of the run [s]
function play(on) {
  const now = Number(slider.value);
  playing = on ? { began: performance.now(), from: now < frames - 1 ? data.time[now] : 0 } : null;
  element("play").textContent = on ? "Pause" : "Play";
  if (on) requestAnimationFrame(advance);
}

function frameAt(time) {
  const later = data.time.findIndex((each) => each > time);
  return later < 0 ? frames - 1 : Math.max(0, later - 1);
}

function advance(clock) {
  if (!playing) return;
  const now = frameAt(playing.from + Math.max(0, clock - playing.began) / 1e3);
  show(now);
  if (now === frames - 1) play(false);
  else requestAnimationFrame(advance);
}

element("play").addEventListener("click", () => play(!playing));
slider.addEventListener("input", () => {
  play(false);
  show(Number(slider.value));
});
for (const canvas of document.querySelectorAll(".plot")) {
  canvas.addEventListener("click", (event) => {
    play(false);
    show(frameAt((last * (event.offsetX - LEFT)) / (canvas.clientWidth - LEFT - 8)));
  });
}
window.addEventListener("resize", () => show(Number(slider.value)));

element("statuses").innerHTML = [...new Set(data.status)]
  .map((word) => `<span class="key"><i style="background:${data.statusColours[word]}"></i>${word}</span>`)
  .join("");
if (!data.pictures.length) for (const name of ["touch", "model"]) element(name).parentElement.remove();
show(frames - 1);
