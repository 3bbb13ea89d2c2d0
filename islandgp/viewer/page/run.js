const run = JSON.parse(document.getElementById("data").textContent);
const byId = id => document.getElementById(id);
const SVG = "http://www.w3.org/2000/svg";
// As `in_points` of text.py: whole from 100 on, else three digits.
const number = (value, digits) => digits === undefined
  ? ((Math.abs(value) >= 100 ? Math.round(value) : Number(value.toPrecision(3))) || 0).toLocaleString("en", {maximumFractionDigits: 12})
  : (Math.abs(value) < 0.5 * 10 ** -digits ? 0 : value).toLocaleString("en", {minimumFractionDigits: digits, maximumFractionDigits: digits});
const signed = value => (value >= 0 ? "+" : "") + number(value);
const percent = value => `${number(100 * value, value && value < 0.1 ? 1 : 0)} %`;

function make(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}
function draw(parent, name, attributes = {}, text = "") {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.textContent = text;
  parent.append(element);
  return element;
}
function copyButton(text) {
  const button = make("button", {type: "button"}, "copy");
  button.addEventListener("click", () => copy(button, text));
  return button;
}
async function copy(button, text) {
  try {
    await navigator.clipboard.writeText(text);
    button.textContent = "copied";
  } catch {  // a page in a frame, or an older browser
    const area = make("textarea", {readonly: ""});
    area.value = text;
    button.after(area);
    area.select();
    const done = document.execCommand("copy");
    area.remove();
    button.textContent = done ? "copied" : "select the text to copy it";
  }
}
for (const button of document.querySelectorAll(".copy")) {
  button.addEventListener("click", () => copy(button, button.parentElement.querySelector("code").textContent));
}

// Round numbers in a range.
function marks(low, high, about) {
  const rough = (high - low) / Math.max(1, about), power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map(m => m * power).find(m => m >= rough);
  const found = [];
  for (let i = Math.ceil(low / step); i <= Math.floor(high / step + 1e-9); i++) found.push(i * step);
  return found;
}
const short = value => (value || 0).toLocaleString("en", {notation: Math.abs(value) >= 1e5 ? "compact" : "standard", maximumSignificantDigits: 4});

// Curves against episodes, a readout below them for the place under the pointer.
function chart(id, title, lines, {text = short, low = null, high = null} = {}) {
  const host = byId(id), key = byId(`${id}-key`), x = run.curves.episodes, n = x.length;
  const values = lines.flatMap(line => line.values);
  let least = low ?? Math.min(0, ...values), most = high ?? Math.max(0, ...values);
  if (!(most > least)) most = least + 1;
  let at = n - 1;
  host.setAttribute("role", "img");
  host.setAttribute("aria-label", n ? `${title}, over ${number(x[n - 1], 0)} episodes: ` +
    lines.map(line => `${line.name} ends at ${text(line.values[n - 1])}`).join(", ") : `${title}: nothing yet`);
  function readout() {
    key.replaceChildren(make("span", {}, n ? `${title} after ${number(x[at], 0)} episodes (generation ${run.curves.generation[at]})` : `${title}: nothing yet`));
    for (const line of n ? lines : []) {
      const sample = document.createElementNS(SVG, "svg");
      draw(sample, "path", {d: "M1 4H21", style: `stroke:var(--${line.colour})`, "stroke-width": line.dots ? 4 : 2,
        "stroke-dasharray": line.dots ? "0 6" : line.dash ?? "", "stroke-linecap": line.dots ? "round" : "butt"});
      sample.setAttribute("aria-hidden", "true");
      key.append(make("span", {}, sample, `${line.name} ${text(line.values[at])}`));
    }
  }
  function paint() {
    const width = host.clientWidth, height = host.clientHeight, svg = document.createElementNS(SVG, "svg");
    const ticks = marks(least, most, height / 45), labels = ticks.map(text);
    const left = 12 + 6.6 * Math.max(...labels.map(label => label.length)), right = 10, top = 16, bottom = 22;
    const across = value => left + (width - left - right) * (n > 1 ? (value - x[0]) / (x[n - 1] - x[0]) : 0.5);
    const up = value => height - bottom - (height - top - bottom) * (value - least) / (most - least);
    ticks.forEach((tick, i) => {
      draw(svg, "path", {class: "rule", d: `M${left} ${up(tick)}H${width - right}`});
      draw(svg, "text", {x: left - 6, y: up(tick) + 4, "text-anchor": "end"}, labels[i]);
    });
    let free = -Infinity;
    for (const [episode, stage] of run.curves.stages.slice(1)) {
      draw(svg, "path", {class: "stage", d: `M${across(episode)} ${top}V${height - bottom}`});
      if (across(episode) < free || width - across(episode) < 52) continue;
      draw(svg, "text", {x: across(episode) + 3, y: top - 4}, `stage ${stage}`);
      free = across(episode) + 58;
    }
    if (n) {
      for (const tick of marks(x[0], Math.max(x[n - 1], x[0] + 1), width / 110)) {
        if (across(tick) > left - 1 && across(tick) < width - right + 1)
          draw(svg, "text", {x: across(tick), y: height - 5, "text-anchor": across(tick) > width - 40 ? "end" : "middle"}, short(tick));
      }
      for (const line of lines) {
        const points = line.values.map((value, i) => `${across(x[i]).toFixed(1)} ${up(value).toFixed(1)}`);
        const d = line.dots ? points.map(point => `M${point}h0`).join("") : `M${points.join("L")}${n === 1 ? "h0" : ""}`;
        draw(svg, "path", {class: line.dots ? "dots" : "line", style: `stroke:var(--${line.colour})`,
          "stroke-dasharray": line.dash ?? "", d});
      }
      draw(svg, "path", {class: "now", d: `M${across(x[at])} ${top}V${height - bottom}`, "stroke-width": at === n - 1 ? 0 : 1});
    }
    svg.setAttribute("aria-hidden", "true");
    host.replaceChildren(svg);
    host.across = across;
  }
  const go = place => {
    at = Math.min(n - 1, Math.max(0, place));
    paint();
    readout();
  };
  host.addEventListener("pointermove", event => {
    const px = event.clientX - host.getBoundingClientRect().left;
    let nearest = 0;
    x.forEach((value, i) => {
      if (Math.abs(host.across(value) - px) < Math.abs(host.across(x[nearest]) - px)) nearest = i;
    });
    if (nearest !== at && n) go(nearest);
  });
  host.addEventListener("pointerleave", () => n && go(n - 1));
  host.addEventListener("keydown", event => {
    const step = {ArrowLeft: at - 1, ArrowRight: at + 1, Home: 0, End: n - 1}[event.key];
    if (step === undefined || !n) return;
    event.preventDefault();
    go(step);
  });
  new ResizeObserver(() => { paint(); readout(); }).observe(host);
}

const curves = run.curves, DASHES = ["", "7 4", "2 3", "9 3 2 3"];
chart("fitness", "Fitness, points", [
  {name: "best of a generation", values: curves.fitness_max, colour: "part-3", dots: true},
  {name: "best so far in the stage", values: curves.best_of_stage, colour: "part-3"},
  {name: "mean", values: curves.fitness_mean, colour: "part-0", dash: "7 4"},
], {text: value => Math.abs(value) >= 1e5 ? short(value) : number(value)});
chart("tiers", "Share of the individuals by tier", Object.entries(curves.tiers).map(([name, values], i) => ({
  name: name.replaceAll("_", " "), values, colour: `part-${[5, 3, 2, 1, 6, 0, 7, 4][i % 8]}`, dash: DASHES[i % 4],
})), {text: percent, low: 0, high: Math.max(0.1, ...Object.values(curves.tiers).flat())});

// The map: two axes at a time. A cell has the best of its elites over all other axes.
function showArchive(archive) {
  const {axes, elites} = archive, n = elites.length;
  const cells = axes.reduce((product, axis) => product * axis.edges.length, 1);
  const score = curves.qd_score.at(-1) ?? 0;
  const low = n && !score ? " No elite is above it; set archive.floor to the lowest possible fitness." : "";
  const facts = archive.readable ? `${number(n, 0)} of ${number(cells, 0)} cells have an elite, the best tree of its cell ` +
    `(coverage ${percent(n / cells)}). QD score ${short(score)}: the sum of the elites' mean points above ` +
    `${number(archive.floor)} (archive.floor).${low}`
    : `The elites themselves cannot be read: ${archive.file} is missing or damaged.`;
  byId("archive-facts").textContent = facts;
  byId("archive-charts").hidden = false;
  chart("coverage", "Coverage", [{name: "share of the cells", values: curves.coverage, colour: "part-5"}], {text: percent, low: 0});
  chart("qd", "QD score", [{name: "points", values: curves.qd_score, colour: "part-6"}], {low: 0});
  if (!n) return;
  byId("archive-map").hidden = false;
  const range = (axis, place) => {
    const {edges} = axes[axis], from = place ? edges[place] : null, to = edges[place + 1];
    return to === undefined ? `${from} or more` : from === null ? `below ${to}` : `${from} to below ${to}`;
  };
  const byMean = [...elites].sort((a, b) => a.mean - b.mean);
  const rank = new Map(byMean.map((e, i) => [e, n > 1 ? i / (n - 1) : 1]));
  const best = elites[0];  // of the last stage
  const shown = [0, Math.min(1, axes.length - 1)];  // the axes to the right and upwards
  let chosen = elites.find(e => `#cell-${e.cell.join("-")}` === location.hash) ?? best, place = new Map();

  function paint() {
    const host = byId("map"), width = host.clientWidth, [a, b] = shown, flat = a === b;
    const columns = axes[a].edges, rows = flat ? [""] : axes[b].edges, svg = document.createElementNS(SVG, "svg");
    const left = flat ? 8 : 34 + 6.6 * Math.max(...rows.map(edge => String(edge).length)), bottom = 38, top = 4;
    const across = Math.max(8, Math.min(64, (width - left - 8) / columns.length)), up = Math.max(16, Math.min(34, across));
    const height = top + up * rows.length + bottom, low = top + up * rows.length;
    svg.setAttribute("width", Math.max(1, Math.min(width, left + across * columns.length + 8)));
    svg.setAttribute("height", height);
    svg.setAttribute("aria-hidden", "true");
    place = new Map();
    const corner = cell => [left + cell[a] * across, flat ? top : low - (cell[b] + 1) * up];
    const skip = Math.ceil(8 * Math.max(...columns.map(edge => String(edge).length)) / across);
    columns.forEach((edge, i) => {
      if (i % skip === 0) draw(svg, "text", {x: left + i * across, y: low + 15, "text-anchor": i ? "middle" : "start"}, String(edge));
      rows.forEach((_, k) => draw(svg, "rect", {class: "empty", x: left + i * across, y: top + k * up, width: across, height: up}));
    });
    draw(svg, "text", {x: left + across * columns.length / 2, y: low + 32, "text-anchor": "middle"}, `${axes[a].name}, from`);
    if (!flat) {
      rows.forEach((edge, k) => draw(svg, "text", {x: left - 5, y: low - k * up + (k ? 4 : 0), "text-anchor": "end"}, String(edge)));
      const middle = top + up * rows.length / 2;
      draw(svg, "text", {x: 12, y: middle, "text-anchor": "middle", transform: `rotate(-90 12 ${middle})`}, `${axes[b].name}, from`);
    }
    const groups = new Map();  // of the elites in one cell of the map, the best first
    for (const e of [...byMean].reverse()) {
      const key = `${e.cell[a]} ${e.cell[b]}`;
      groups.set(key, [...(groups.get(key) ?? []), e]);
    }
    for (const [first, ...others] of groups.values()) {
      const [x, y] = corner(first.cell), [e, ...rest] = [first, ...others];
      place.set(e, [x + across / 2, y + up / 2]);
      const cell = draw(svg, "rect", {class: "elite", x, y, width: across, height: up, style: `--v:${rank.get(e).toFixed(3)}`});
      draw(cell, "title", {}, `${[...new Set(shown)].map(k => `${axes[k].name} ${range(k, e.cell[k])}`).join(", ")}: ` +
        `${number(e.mean)} points, the best of ${rest.length + 1}`);
      cell.addEventListener("click", () => choose(e));
      if ([e, ...rest].includes(best)) draw(svg, "circle", {class: "best", cx: x + across / 2, cy: y + up / 2, r: up / 6});
    }
    const [x, y] = corner(chosen.cell), box = {x, y, width: across, height: up};
    place.set(chosen, [x + across / 2, y + up / 2]);
    draw(svg, "rect", {class: "halo", ...box});
    draw(svg, "rect", {class: "chosen", ...box});
    host.replaceChildren(svg);
  }
  function choose(e, keep = true) {
    chosen = e;
    if (keep) try { history.replaceState(null, "", `#cell-${e.cell.join("-")}`); } catch { /* a frame */ }
    byId("cells").value = String(elites.indexOf(e));
    paint();
    const facts = make("dl");
    const fact = (name, value) => facts.append(make("dt", {}, name), make("dd", {}, value));
    axes.forEach((axis, k) => fact(axis.name, range(k, e.cell[k])));
    fact("mean", `${number(e.mean)} points over ${e.episodes} episode${e.episodes === 1 ? "" : "s"}`);
    fact("individual", e.id + (run.curves.stages.length > 1 ? `, points of stage ${e.stage}` : ""));
    const parts = [facts];
    if (e.tree === null) {
      parts.push(make("p", {class: "soft"}, `Its tree is in ${archive.file}: the page has no room for all of them.`));
    } else {
      const head = archive.domain ? `domain ${archive.domain}\n\n` : "";
      const command = `${archive.command} --seed ${e.world} --stage ${e.stage} -o cell.html <<'TREE'\n${head}${e.tree}TREE`;
      parts.push(make("pre", {tabindex: "0", "aria-label": "Tree of the elite"}, e.tree));
      parts.push(make("p", {class: "command"}, "The command that replays this tree: ", copyButton(command)));
      parts.push(make("details", {}, make("summary", {}, "The command"), make("pre", {tabindex: "0"}, command)));
    }
    byId("cell").replaceChildren(...parts);
  }
  ["across", "up"].forEach((id, k) => {
    byId(id).replaceChildren(...axes.map((axis, i) => make("option", {value: i}, axis.name)));
    byId(id).value = String(shown[k]);
    byId(id).addEventListener("change", event => { shown[k] = Number(event.target.value); paint(); });
  });
  byId("scale-low").textContent = number(byMean[0].mean);
  byId("scale-high").textContent = `${number(byMean[n - 1].mean)} points, by rank; the dot marks the best elite`;
  byId("cells").replaceChildren(...elites.map((e, i) => make("option", {value: i},
    `${number(e.mean)} points: ${axes.map((axis, k) => `${axis.name} ${range(k, e.cell[k])}`).join(", ")}`)));
  byId("cells").addEventListener("change", event => choose(elites[Number(event.target.value)]));
  byId("map").addEventListener("keydown", event => {
    const way = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1]}[event.key];
    if (!way) return;
    event.preventDefault();
    const [x, y] = place.get(chosen);
    let next = null, nearest = Infinity;
    for (const [e, [u, v]] of place) {
      const along = (u - x) * way[0] + (v - y) * way[1], aside = Math.abs((u - x) * way[1]) + Math.abs((v - y) * way[0]);
      if (along > 0.5 && along + 3 * aside < nearest) [next, nearest] = [e, along + 3 * aside];
    }
    if (next) choose(next);
  });
  choose(chosen, false);
  new ResizeObserver(paint).observe(byId("map"));
}
if (run.archive) showArchive(run.archive);

// The front of size against points, with intervals; the tree of a chosen size.
function showFront(rows) {
  const trees = [...new Map(rows.toReversed().map(tree => [tree.nodes, tree])).values()].sort((a, b) => a.nodes - b.nodes);
  const at = ({difference: d}) => d ? [d.mean, d.low ?? d.mean, d.high ?? d.mean] : [0, 0, 0];
  let chosen = trees.find(tree => tree.chosen) ?? trees[0];
  const all = trees.flatMap(at), host = byId("front-chart"), last = trees.at(-1).nodes;
  const least = Math.min(0, ...all), most = Math.max(0, ...all) > least ? Math.max(0, ...all) : least + 1;
  byId("front").hidden = false;
  host.setAttribute("role", "img");
  host.setAttribute("aria-label", trees.map(tree => `${tree.nodes} nodes: ${signed(at(tree)[0])} points`).join(", "));
  function paint() {
    const width = host.clientWidth, height = host.clientHeight, svg = document.createElementNS(SVG, "svg");
    const ticks = marks(least, most, height / 45), left = 14 + 6.6 * Math.max(...ticks.map(tick => signed(tick).length));
    const across = nodes => left + 12 + (width - left - 30) * nodes / last;
    const up = value => height - 40 - (height - 52) * (value - least) / (most - least);
    for (const tick of ticks) {
      draw(svg, "path", {class: tick ? "rule" : "now", d: `M${left} ${up(tick)}H${width - 6}`, "stroke-width": 1});
      draw(svg, "text", {x: left - 6, y: up(tick) + 4, "text-anchor": "end"}, signed(tick));
    }
    for (const tick of marks(0, last, width / 80)) draw(svg, "text", {x: across(tick), y: height - 20, "text-anchor": "middle"}, number(tick));
    draw(svg, "text", {x: (left + width) / 2, y: height - 3, "text-anchor": "middle"}, "nodes");
    for (const tree of trees) {
      const [mean, low, high] = at(tree), x = across(tree.nodes);
      draw(svg, "path", {class: "span", d: `M${x} ${up(low)}V${up(high)}`});
      const dot = draw(svg, "circle", {cx: x, cy: up(mean), r: 5, class: tree.chosen ? "best" : ""});
      draw(dot, "title", {}, `${tree.nodes} nodes, ${signed(mean)} [${signed(low)}, ${signed(high)}]`);
      dot.addEventListener("click", () => choose(tree));
      if (tree === chosen) draw(svg, "circle", {cx: x, cy: up(mean), r: 10, class: "ring"});
    }
    svg.setAttribute("aria-hidden", "true");
    host.replaceChildren(svg);
  }
  function choose(tree) {
    chosen = tree;
    byId("sizes").value = String(trees.indexOf(tree));
    byId("front-tree").textContent = tree.tree;
    paint();
  }
  byId("sizes").replaceChildren(...trees.map((tree, i) => {
    const [mean, low, high] = at(tree), d = tree.difference;
    const text = !d ? "" : `, ${signed(mean)}${d.low === null ? "" : ` [${signed(low)}, ${signed(high)}]`}`;
    return make("option", {value: i}, `${tree.nodes} nodes${text}${tree.chosen ? ", the best robot" : ""}`);
  }));
  byId("sizes").addEventListener("change", event => choose(trees[Number(event.target.value)]));
  choose(chosen);
  new ResizeObserver(paint).observe(host);
}
if (run.front.length) showFront(run.front);

const replay = JSON.parse(byId("replay").textContent);
if (replay) {
  const frame = make("iframe", {title: "Replay of the best robot", sandbox: "allow-scripts"});
  frame.srcdoc = replay;
  byId("replay-place").append(frame);
}

// The page loads itself again while the run goes on, and stays where it was.
function age() {
  const minutes = Math.floor((Date.now() - run.updated) / 60000);
  const when = new Date(run.updated).toLocaleString();
  byId("updated").textContent = !run.updated ? "" : run.status !== "RUNNING" || minutes < 2 ? `as of ${when}`
    : `as of ${when}, ${minutes} minutes ago: is the run still at work?`;
}
age();
const store = (key, value) => { try { return value === undefined ? sessionStorage.getItem(key) : sessionStorage.setItem(key, value); } catch { return null; } };
// What a reader opened stays open when the page is loaded again.
for (const part of document.querySelectorAll("main > details")) {
  const key = `open ${location.pathname} ${part.id}`, before = store(key);
  if (before) part.open = before === "1";
  part.addEventListener("toggle", () => store(key, part.open ? "1" : "0"));
}
if (location.hash.startsWith("#cell-")) byId("archive").open = true;
if (run.status === "RUNNING" && /^(file|https?):$/.test(location.protocol)) {
  const pause = byId("pause"), key = `pause ${location.pathname}`;
  const show = () => {
    const paused = store(key) === "1";
    pause.setAttribute("aria-pressed", String(paused));
    pause.textContent = paused ? "updates are paused" : "pause updates";
  };
  pause.hidden = false;
  show();
  pause.addEventListener("click", () => { store(key, store(key) === "1" ? "0" : "1"); show(); });
  setInterval(() => {
    age();
    if (store(key) !== "1" && !document.hidden && document.activeElement?.tagName !== "SELECT") location.reload();
  }, run.reload * 1000);
}
