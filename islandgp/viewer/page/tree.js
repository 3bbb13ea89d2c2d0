// The live tree: which node does what now, and why.
const tree = (() => {
  const svg = document.getElementById("tree"), holder = document.getElementById("nodes");
  const nodes = [...svg.querySelectorAll(".node")], edges = [...svg.querySelectorAll(".edge")];
  const view = {scale: 1, x: 0, y: 0, fitted: true, width: 1, height: 1};  // px of the place for it
  const shown = nodes.map(() => ""), lit = edges.map(() => false), met = nodes.map(() => false);
  const badges = {r: "\u25b6", s: "\u2713", f: "\u2717", x: "\u2298"};
  const texts = [];
  const SVG = "http://www.w3.org/2000/svg";

  const PADDING = 16;  // px beside a label, as in bt/export/render.py
  const widths = [];
  nodes.forEach((node, i) => {
    const badge = document.createElementNS(SVG, "g"), disc = document.createElementNS(SVG, "circle");
    const text = document.createElementNS(SVG, "text");
    const width = PADDING + Number(node.querySelector("text").getAttribute("textLength"));
    badge.setAttribute("class", "badge");
    badge.setAttribute("transform", `translate(${width - 2} -10)`);
    disc.setAttribute("r", "6.5");
    text.setAttribute("y", "3.2");
    widths.push(width);
    badge.append(disc, text);
    node.append(badge);
    texts.push(text);
    node.dataset.place = i;
  });

  // Two layouts: the root at the left, as in bt/export/render.py; and an outline, a row for each
  // node, for where that one would be too small to read.
  const across = {
    width: Number(svg.dataset.width), height: Number(svg.dataset.height),
    places: nodes.map(node => /([\d.]+) ([\d.]+)/.exec(node.getAttribute("transform")).slice(1).map(Number)),
    lines: edges.map(edge => edge.getAttribute("d")),
  };
  const outline = (() => {
    const MARGIN = 8, ROW = 28, INDENT = 20, HALF = 11;  // px
    const places = [], lines = [];
    episode.nodes.forEach(({parent}, i) => {
      const [left, above] = parent < 0 ? [MARGIN - INDENT] : places[parent], y = MARGIN + ROW * (i + 0.5);
      places.push([left + INDENT, y]);
      if (i) lines.push(`M${left + INDENT / 2} ${above + HALF}V${y}H${left + INDENT}`);
    });
    const right = Math.max(...places.map(([x], i) => x + widths[i]));
    return {width: right + MARGIN, height: 2 * MARGIN + ROW * nodes.length, places, lines};
  })();
  let layout = across;
  function arrange(wanted) {
    if (wanted === layout) return;
    layout = wanted;
    nodes.forEach((node, i) => node.setAttribute("transform", `translate(${layout.places[i].join(" ")})`));
    edges.forEach((edge, i) => edge.setAttribute("d", layout.lines[i]));
    view.fitted = true;
  }

  const starts = episode.statuses.map(({ticks, values}) =>
    ticks.filter((_, i) => values[i] !== "." && (i === 0 || values[i - 1] !== "r")));

  // The status at a tick; a node that was just ticked keeps it for `window` ticks, so that what
  // takes a single tick can be seen while the page plays fast.
  function status(place, tick, window) {
    const {ticks, values} = episode.statuses[place], i = lastBefore(ticks, tick);
    if (values[i] !== "." || i === 0) return values[i];
    return tick - ticks[i] < window ? values[i - 1] : ".";
  }

  function draw(tick, window) {
    const now = Math.floor(tick);
    for (let place = 0; place < nodes.length; place++) {
      const letter = status(place, now, window), seen = letter !== "." || episode.statuses[place].ticks.length > 1;
      if (letter !== shown[place]) {
        nodes[place].classList.remove("r", "s", "f", "x");
        if (letter !== ".") {
          nodes[place].classList.add(letter);
          texts[place].textContent = badges[letter];
        }
        shown[place] = letter;
      }
      if (seen !== met[place]) {
        nodes[place].classList.toggle("seen", seen);
        met[place] = seen;
      }
      const on = letter === "r" || letter === "s";
      if (place && on !== lit[place - 1]) {
        edges[place - 1].classList.toggle("on", on);
        lit[place - 1] = on;
      }
    }
    showWhy(now);
    reveal();
  }

  // A tree that is larger than its place moves so that what runs is in sight.
  function reveal() {
    const at = shown.lastIndexOf("r");
    if (!view.fitted || at < 0) return;
    const [x, y] = layout.places[at], {width, height} = view;
    const seen = (from, to, room) => from > 0 && to < room;
    const left = x * view.scale + view.x, middle = y * view.scale + view.y;
    if (seen(left, left + widths[at] * view.scale, width) && seen(middle - 24, middle + 24, height)) return;
    lookAt(at);
    holder.setAttribute("transform", `translate(${view.x} ${view.y}) scale(${view.scale})`);
  }

  // What the robot does now: the running actions, each with the nodes that lead to it.
  const why = document.getElementById("why");
  let lastKey = null;
  function showWhy(tick) {
    const acting = [];
    episode.nodes.forEach((node, place) => {
      if (node.kind === "action" && status(place, tick, 0) !== "." && status(place, tick, 0) !== "x") acting.push(place);
    });
    const key = acting.map(place => place + status(place, tick, 0)).join();
    if (key === lastKey) return;
    lastKey = key;
    const paths = acting.map(place => {
      const above = [];
      for (let at = episode.nodes[place].parent; at > 0; at = episode.nodes[at].parent) {
        if (episode.nodes[at].kind !== "sequence" && episode.nodes[at].kind !== "selector") above.unshift(episode.nodes[at].label);
      }
      return [badges[status(place, tick, 0)], above.map(escaped).join(" &rsaquo; "), `<b>${escaped(episode.nodes[place].label)}</b>`]
        .filter(Boolean).join(" &nbsp;");
    });
    why.innerHTML = paths.join(" &nbsp;&middot;&nbsp; ") || "nothing";
  }
  // Where there is no room for the whole tree, this node comes to the middle.
  const lookAt = at => {
    const moved = (room, size, to) => size <= room ? (room - size) / 2 : Math.min(0, Math.max(room - size, room / 2 - to));
    const [x, y] = layout.places[at], {scale, width, height} = view;
    view.x = moved(width, layout.width * scale, (x + widths[at] / 2) * scale);
    view.y = moved(height, layout.height * scale, y * scale);
  };
  // On a narrow screen the page scrolls: the tree takes the height that it needs at this width.
  const READABLE = 0.87;  // scale with letters of 10 px
  const HIGHEST = 0.6;  // of a tree that is not shown whole, as a share of the window
  const SMALLEST = 0.62;  // of a large tree across, beside the world; what has no room then is moved into sight
  const LARGEST = 1.35;
  function room() {
    const box = svg.parentElement, stacked = Number(getComputedStyle(document.body).getPropertyValue("--stacked"));
    arrange(box.clientWidth < across.width * (stacked ? READABLE : SMALLEST) ? outline : across);
    const high = layout.height * scaleFor(box.clientWidth, Infinity), whole = high <= innerHeight * stacked;
    box.style.height = stacked ? (whole ? high : innerHeight * Math.min(HIGHEST, stacked)) + "px" : "";
    svg.style.touchAction = stacked && whole ? "pan-y" : "";  // a finger on a whole tree scrolls the page
  }
  const scaleFor = (width, height) => layout === outline
    ? Math.max(READABLE, Math.min(1, width / layout.width))
    : Math.max(SMALLEST, Math.min(LARGEST, width / layout.width, height / layout.height));
  function place() {
    [view.width, view.height] = [svg.clientWidth, svg.clientHeight];
    if (view.fitted) {
      view.scale = scaleFor(view.width, view.height);
      lookAt(0);
    }
    holder.setAttribute("transform", `translate(${view.x} ${view.y}) scale(${view.scale})`);
  }
  function zoom(factor, px, py) {
    const before = view.scale;
    view.scale = Math.min(4, Math.max(0.08, view.scale * factor));
    view.x = px - (px - view.x) * view.scale / before;
    view.y = py - (py - view.y) * view.scale / before;
    view.fitted = false;
    place();
  }

  return {svg, draw, place, room, zoom, status, starts,
    moved(dx, dy) { view.x += dx; view.y += dy; view.fitted = false; place(); },
    fit() { view.fitted = true; place(); }};
})();
