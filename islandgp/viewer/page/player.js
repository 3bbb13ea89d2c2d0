// Time: playing, pausing, stepping, scrubbing; keys and pointers; one frame at a time.
const player = (() => {
  const SPEEDS = [0.25, 0.5, 1, 2, 5, 10, 20, 50, 100];
  const AFTERGLOW = 0.45;  // s on the viewer's clock for which a short status stays lit
  const RISE = 1.4;  // s on the viewer's clock for which points rise
  const PAUSED = episode.ticks / 400;  // ticks for which they are shown while nothing plays
  const last = Math.max(0, episode.ticks - 1);
  const one = id => document.getElementById(id);
  const state = {tick: 0, playing: false, speed: 10};
  let before = 0, stale = true;

  const perSecond = () => state.speed / episode.step;
  function draw() {
    const {tick, playing} = state;
    scene?.draw(tick, playing ? RISE * perSecond() : PAUSED);
    tree.draw(tick, playing ? AFTERGLOW * perSecond() : 0);
    board.draw(tick);
    one("score").textContent = points(chart.draw(tick)) + " points";
    timeline.draw(tick);
    one("clock").textContent = seconds(Math.floor(tick)).toFixed(1) + " s";
  }
  function frame(now) {
    const passed = now - before;
    before = now;
    if (state.playing) {
      state.tick += Math.min(passed, 250) / 1000 * perSecond();
      stale = true;
      if (state.tick >= last) { state.tick = last; play(false); }
    }
    if (stale) {
      stale = false;
      draw();
    }
    requestAnimationFrame(frame);
  }

  function play(on = !state.playing) {
    if (on && state.tick >= last) state.tick = 0;
    state.playing = on;
    one("play").classList.toggle("on", on);
    if (!on) state.tick = Math.floor(state.tick);
    stale = true;
  }
  function seek(tick) {
    state.tick = Math.max(0, Math.min(last, tick));
    stale = true;
  }
  function step(ticks) {
    play(false);
    seek(Math.round(state.tick) + ticks);
  }
  function speed(value) {
    state.speed = value;
    one("speed").value = String(value);
    stale = true;
  }
  const faster = by => speed(SPEEDS[Math.max(0, Math.min(SPEEDS.length - 1, SPEEDS.indexOf(state.speed) + by))]);
  const pressed = on => one("follow")?.setAttribute("aria-pressed", String(on));
  const follow = () => {
    if (!scene?.robot) return;
    scene.follow(!scene.view.follow);
    pressed(scene.view.follow);
    stale = true;
  };
  const fit = () => {
    if (!scene) return;
    scene.view.follow = false;
    scene.fit();
    pressed(false);
    stale = true;
  };
  const zoom = factor => { scene?.zoom(factor); stale = true; };

  // A decision: an action starts that did not run before.
  const decisions = [...new Set(tree.starts.filter((_, place) => episode.nodes[place].kind === "action").flat())]
    .sort((a, b) => a - b);
  const decision = forth => {
    const now = Math.floor(state.tick);
    const found = forth ? decisions.find(t => t > now) : decisions.findLast(t => t < now);
    if (found !== undefined) { play(false); seek(found); }
  };

  const keys = {
    " ": () => play(), "[": () => faster(-1), "]": () => faster(1),
    "ArrowLeft": event => step(event.shiftKey ? -10 / episode.step : -1),
    "ArrowRight": event => step(event.shiftKey ? 10 / episode.step : 1),
    ",": () => decision(false), ".": () => decision(true),
    "Home": () => seek(0), "End": () => seek(last), "f": follow, "0": fit,
    "+": () => zoom(1.3), "=": () => zoom(1.3), "-": () => zoom(1 / 1.3),
    "?": () => one("keys").showModal(),
  };
  addEventListener("keydown", event => {
    const act = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act || event.ctrlKey || event.metaKey || event.altKey || one("keys").open) return;
    if (event.target.closest("select") || (event.key === " " && event.target.closest("button"))) return;
    event.preventDefault();
    act(event);
  });
  one("start").onclick = () => seek(0);
  one("back").onclick = () => step(-1);
  one("play").onclick = () => play();
  one("forth").onclick = () => step(1);
  one("help").onclick = () => one("keys").showModal();
  for (const [id, act] of [["follow", follow], ["zoom-in", () => zoom(1.3)], ["zoom-out", () => zoom(1 / 1.3)], ["zoom-fit", fit]]) {
    one(id)?.addEventListener("click", act);
  }
  one("speed").innerHTML = SPEEDS.map(s => `<option value="${s}">${s}\u00d7</option>`).join("");
  one("speed").onchange = event => { speed(Number(event.target.value)); event.target.blur(); };
  for (const button of document.querySelectorAll("button")) button.addEventListener("click", () => button.blur());

  // Dragging and the wheel, the same for the scene and the tree.
  function movable(element, moved, zoomed, fitted, clicked) {
    let from = null, far = false;
    element.addEventListener("pointerdown", event => {
      from = [event.clientX, event.clientY];
      far = false;
    });
    element.addEventListener("pointermove", event => {
      if (!from) return;
      const [dx, dy] = [event.clientX - from[0], event.clientY - from[1]];
      if (!far && Math.hypot(dx, dy) < 4) return;
      if (!far) element.setPointerCapture(event.pointerId);
      far = true;
      from = [event.clientX, event.clientY];
      moved(dx, dy);
      stale = true;
    });
    const end = event => {
      if (from && !far && event.type === "pointerup") clicked?.(event);
      from = null;
    };
    element.addEventListener("pointerup", end);
    element.addEventListener("pointercancel", end);
    element.addEventListener("wheel", event => {
      event.preventDefault();
      const box = element.getBoundingClientRect();
      zoomed(Math.exp(-event.deltaY * 0.0015), event.clientX - box.left, event.clientY - box.top);
      stale = true;
    }, {passive: false});
    element.addEventListener("dblclick", () => { fitted(); stale = true; });
  }
  if (scene) {
    movable(scene.canvas, scene.moved, scene.zoom, fit);
    scene.hooks.ready = () => { stale = true; };
  }
  movable(tree.svg, tree.moved, tree.zoom, tree.fit, event => {
    const node = event.target.closest(".node");
    if (!node) return;
    const starts = tree.starts[Number(node.dataset.place)];
    const next = starts.find(tick => tick > Math.floor(state.tick)) ?? starts[0];
    if (next !== undefined) { play(false); seek(next); }
  });
  const scrub = event => {
    if (event.type === "pointerdown") timeline.canvas.setPointerCapture(event.pointerId);
    else if (!event.buttons) return;
    seek(Math.round(timeline.tickAt(event.clientX - timeline.canvas.getBoundingClientRect().left)));
  };
  timeline.canvas.addEventListener("pointerdown", scrub);
  timeline.canvas.addEventListener("pointermove", scrub);

  const redrawAll = () => {
    for (const name of Object.keys(colours)) delete colours[name];
    tree.room();
    timeline.room();
    tree.place();
    stale = true;
  };
  const sizes = new ResizeObserver(redrawAll);
  for (const element of [document.body, tree.svg, ...document.querySelectorAll("canvas")]) sizes.observe(element);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redrawAll);

  one("facts").textContent = [episode.domain, `seed ${episode.seed}`, `stage ${episode.stage}`,
    `${timeText(Number(episode.seconds.toPrecision(4)))}, ended by ${episode.ending}`,
    `${episode.nodes.length} nodes`, `final fitness ${points(episode.fitness)}`].join("  \u00b7  ");

  // The address may say where to begin: replay.html#t=63.5&play=20
  const asked = new URLSearchParams(location.hash.slice(1));
  // An episode is played in less than a minute.
  speed(SPEEDS.find(value => seconds(episode.ticks) / value <= 60) ?? SPEEDS[SPEEDS.length - 1]);
  if (asked.has("t")) seek(Math.round(Number(asked.get("t")) / episode.step));
  if (asked.has("play")) { if (SPEEDS.includes(Number(asked.get("play")))) speed(Number(asked.get("play"))); play(true); }
  redrawAll();
  requestAnimationFrame(now => { before = now; frame(now); });
  return {state, play, seek, speed, step, follow};
})();
