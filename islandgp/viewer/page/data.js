// Reads what viewer/encode.py wrote: the episode as arrays and as sorted changes.
const data = JSON.parse(document.getElementById("data").textContent);
const TENTHS = 10;

const summed = differences => {
  let sum = 0;
  return Float32Array.from(differences, d => (sum += d) / TENTHS);
};
const wayOf = way => ({every: way.every, x: summed(way.x), y: summed(way.y)});

// [tick, value, ticks since then, value, ...] as two arrays; `at` finds the value of a tick.
const changesOf = list => {
  const ticks = [], values = [];
  for (let i = 0, tick = 0; i < list.length; i += 2) {
    tick += list[i];
    ticks.push(tick);
    values.push(list[i + 1]);
  }
  return {ticks, values, at: tick => values[lastBefore(ticks, tick)]};
};

// The index of the last entry that is not above `value`; at least 0.
function lastBefore(sorted, value) {
  let low = 0, high = sorted.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (sorted[middle] <= value) low = middle; else high = middle - 1;
  }
  return low;
}

// "r3fr" as changes of the node's status; "." is a node that was not ticked.
const statusOf = text => {
  const ticks = [], values = [];
  let tick = 0;
  for (const [, letter, count] of text.matchAll(/([.fsrx])(\d*)/g)) {
    ticks.push(tick);
    values.push(letter);
    tick += count ? Number(count) : 1;
  }
  return {ticks, values, at: t => values[lastBefore(ticks, t)]};
};

const episode = {
  ...data,
  robot: wayOf(data.robot),
  goals: changesOf(data.goals),
  humanoids: data.humanoids.map(wayOf),
  carried: data.carried.map(changesOf),
  garbage: data.garbage.map(([x, y, from, to]) => ({x: x / TENTHS, y: y / TENTHS, from, to})),
  board: data.board.map(entry => ({...entry, ...changesOf(entry.changes)})),
  credits: data.credits.map(([tick, component, points, event]) => ({tick, component, points, event})),
  statuses: data.statuses.map(statusOf),
};

// Where somebody is at a tick, which may lie between two: straight lines in between.
function placeAt(way, tick) {
  const at = tick / way.every, i = Math.min(Math.floor(at), way.x.length - 1);
  const j = Math.min(i + 1, way.x.length - 1), part = Math.min(1, at - i);
  return [way.x[i] + (way.x[j] - way.x[i]) * part, way.y[i] + (way.y[j] - way.y[i]) * part];
}

// Sum of points per component after each credit, so that any tick is one look-up.
const totals = (() => {
  const ticks = [-1], sums = [new Float64Array(episode.components.length)];
  for (const credit of episode.credits) {
    const next = Float64Array.from(sums[sums.length - 1]);
    next[credit.component] += credit.points;
    if (ticks[ticks.length - 1] === credit.tick) sums[sums.length - 1] = next;
    else { ticks.push(credit.tick); sums.push(next); }
  }
  return {ticks, sums, at: tick => sums[lastBefore(ticks, tick)]};
})();

const seconds = tick => tick * episode.step;
const points = value => Math.round(value).toLocaleString("en");

// A colour of the style sheet, by name; read anew when the theme changes.
const colours = {};
function colour(name) {
  return colours[name] ??= getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
}

// A canvas with as many dots as the screen has; gives [context, width, height] in CSS px.
function sharp(canvas) {
  const box = canvas.getBoundingClientRect(), ratio = window.devicePixelRatio || 1;
  const width = Math.max(1, Math.round(box.width * ratio));
  const height = Math.max(1, Math.round(box.height * ratio));
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return [context, box.width, box.height];
}
