// The live tree: which node does what now, and why.
const tree = (() => {
  const svg = document.getElementById("tree"), holder = document.getElementById("nodes");
  const nodes = [...svg.querySelectorAll(".node")], edges = [...svg.querySelectorAll(".edge")];
  const size = {width: Number(svg.dataset.width), height: Number(svg.dataset.height)};
  const view = {scale: 1, x: 0, y: 0, fitted: true};
  const shown = nodes.map(() => ""), lit = edges.map(() => false), met = nodes.map(() => false);
  const badges = {r: "\u25b6", s: "\u2713", f: "\u2717", x: "\u2298"};
  const texts = [];
  const SVG = "http://www.w3.org/2000/svg";

  nodes.forEach((node, i) => {
    const badge = document.createElementNS(SVG, "g"), disc = document.createElementNS(SVG, "circle");
    const text = document.createElementNS(SVG, "text"), width = node.firstElementChild.nextElementSibling.getBBox().width;
    badge.setAttribute("class", "badge");
    badge.setAttribute("transform", `translate(${width - 2} -10)`);
    disc.setAttribute("r", "6.5");
    text.setAttribute("y", "3.2");
    badge.append(disc, text);
    node.append(badge);
    texts.push(text);
    node.dataset.place = i;
  });
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
      const on = letter === "r";
      if (place && on !== lit[place - 1]) {
        edges[place - 1].classList.toggle("on", on);
        lit[place - 1] = on;
      }
    }
    tellWhy(now);
    reveal();
  }

  // A tree that is larger than its place moves so that what runs is in sight.
  const heights = nodes.map(node => Number(/ ([\d.]+)\)/.exec(node.getAttribute("transform"))[1]));
  function reveal() {
    const room = svg.clientHeight, high = size.height * view.scale, at = shown.lastIndexOf("r");
    if (!view.fitted || at < 0 || high <= room) return;
    const y = heights[at] * view.scale + view.y;
    if (y > 24 && y < room - 24) return;
    lookAt(heights[at]);
    holder.setAttribute("transform", `translate(${view.x} ${view.y}) scale(${view.scale})`);
  }

  // What the robot does now: the running actions, each with the nodes that lead to it.
  const why = document.getElementById("why");
  let told = null;
  function tellWhy(tick) {
    const acting = [];
    episode.nodes.forEach((node, place) => {
      if (node.kind === "action" && status(place, tick, 0) !== "." && status(place, tick, 0) !== "x") acting.push(place);
    });
    const key = acting.map(place => place + status(place, tick, 0)).join();
    if (key === told) return;
    told = key;
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
  // Where there is no room for the whole height, `y` of the tree comes to the middle.
  const lookAt = y => {
    const room = svg.clientHeight, high = size.height * view.scale;
    view.y = high <= room ? (room - high) / 2 : Math.min(0, Math.max(room - high, room / 2 - y * view.scale));
  };
  // On a narrow screen the page scrolls: the tree takes the height that it needs at this width.
  function room() {
    const box = svg.parentElement, stacked = getComputedStyle(document.body).getPropertyValue("--stacked").trim() === "1";
    const scale = Math.max(READABLE, Math.min(1.35, box.clientWidth / size.width));
    box.style.height = stacked ? Math.min(size.height * scale, innerHeight * 1.2) + "px" : "";
  }
  const READABLE = 0.62;  // scale: a large tree is not shown smaller, it is moved instead
  function place() {
    const box = svg.getBoundingClientRect();
    if (view.fitted) {
      const wide = box.width / size.width;
      view.scale = Math.max(Math.min(1.35, wide, box.height / size.height), Math.min(READABLE, wide));
      view.x = Math.max(0, (box.width - size.width * view.scale) / 2);
      lookAt(heights[0]);  // the root
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
