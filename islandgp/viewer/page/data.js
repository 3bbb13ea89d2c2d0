// Reads what viewer/encode.py wrote: the episode as arrays and as sorted changes.
const data = JSON.parse(document.getElementById("data").textContent);

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

// [tick, x, y, ticks since then, dx, dy, ...] as three arrays.
const wayOf = list => {
  const way = {ticks: [], x: [], y: []};
  for (let i = 0, tick = 0, x = 0, y = 0; i < list.length; i += 3) {
    way.ticks.push(tick += list[i]);
    way.x.push(x += list[i + 1]);
    way.y.push(y += list[i + 2]);
  }
  return way;
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

const sceneOf = scene => {
  const looks = scene.looks.map(([style, size, text]) => ({style: scene.styles[style], size, text}));
  const styles = scene.styles.map(([meaning, shape, colour]) => ({meaning, shape, colour}));
  for (const look of looks) look.style = styles[scene.styles.indexOf(look.style)];
  const thing = ([look, x, y, from, to]) => ({...looks[look], x, y, from, to});
  const ways = scene.movers.map(({way}) => Array.isArray(way) ? wayOf(way) : way);
  return {
    ...scene, styles,
    fixed: scene.fixed.map(thing),
    items: scene.items.map(thing),
    movers: scene.movers.map((mover, i) => {
      const changes = changesOf(mover.looks);
      return {way: typeof ways[i] === "number" ? ways[ways[i]] : ways[i], look: tick => looks[changes.at(tick)]};
    }),
    shown: changesOf(scene.shown),
  };
};

const episode = {
  ...data,
  scene: data.scene && sceneOf(data.scene),
  board: data.board.map(entry => ({...entry, ...changesOf(entry.changes)})),
  credits: data.credits.map(([tick, component, points]) => ({tick, component, points})),
  statuses: data.statuses.map(statusOf),
};

// Where something is at a tick, which may lie between two: straight lines in between.
function placeAt({ticks, x, y}, tick) {
  const i = lastBefore(ticks, tick), j = Math.min(i + 1, ticks.length - 1);
  const part = i === j ? 0 : (tick - ticks[i]) / (ticks[j] - ticks[i]);
  return [x[i] + (x[j] - x[i]) * part, y[i] + (y[j] - y[i]) * part];
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
const sumOf = sums => sums.reduce((a, b) => a + b, 0);

const seconds = tick => tick * episode.step;
const points = value => {
  const text = value.toLocaleString("en", {minimumFractionDigits: episode.digits, maximumFractionDigits: episode.digits});
  return /[1-9]/.test(text) ? text : text.replace("-", "");  // no -0
};

// A colour of the style sheet, by name; read again when the theme changes.
const colours = {};
function colour(name) {
  return colours[name] ??= getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
}
const PAINTS = 8;
const paintOf = component => component < 0 ? "plain" : "part-" + component % PAINTS;

const escaped = text => String(text).replace(/[&<>"]/g, sign => `&#${sign.charCodeAt(0)};`);

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

// Round numbers from `low` to `high`, about `wanted` of them, for an axis.
function marks(low, high, wanted) {
  const rough = (high - low) / Math.max(1, wanted), power = 10 ** Math.floor(Math.log10(rough));
  const by = power * [1, 2, 5, 10].find(m => m * power >= rough * 0.999);
  const found = [];
  for (let i = Math.ceil(low / by - 1e-9); i * by <= high + by * 1e-9; i++) found.push(Number((i * by).toPrecision(12)));
  return found;
}

// The times to write below an axis of `width` px: as many as there is room for.
const times = width => marks(0, Math.max(episode.step, seconds(episode.ticks - 1)), Math.min(12, width / 62));
const timeText = s => s.toLocaleString("en") + " s";
