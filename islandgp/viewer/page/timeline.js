// The course of the episode: a lane for each action, in the colour of what it earned, and the playhead.
const timeline = (() => {
  const canvas = document.getElementById("timeline"), backdrop = document.createElement("canvas");
  const FONT = 'system-ui, "DejaVu Sans", sans-serif';
  const names = [...new Set(episode.nodes.filter(node => node.kind === "action").map(node => node.label))];
  const RIGHT = 18, BOTTOM = 18, LANE = [12.5, 26], BOX = 80;  // px
  const span = Math.max(1, episode.ticks - 1);
  let drawnFor = "", width = 1, height = 1, left = 10;
  const x = tick => left + (width - left - RIGHT) * tick / span;

  // A lane is high enough for its name; very many of them scroll.
  function room() {
    const [high, most] = LANE.map(lane => names.length * lane + BOTTOM);
    const wanted = Math.max(high, Math.min(most, BOX));
    canvas.style.height = wanted + "px";
    canvas.parentElement.style.height = Math.max(Math.min(wanted, BOX), Math.min(wanted, innerHeight * 0.3)) + "px";
  }

  function drawBackdrop(ratio) {
    const key = [width, height, ratio, colour("ink")].join();
    if (key === drawnFor) return;
    drawnFor = key;
    backdrop.width = width * ratio;
    backdrop.height = height * ratio;
    const c = backdrop.getContext("2d"), lane = (height - BOTTOM) / Math.max(1, names.length);
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.font = `${width < 560 ? 9 : 10.5}px ${FONT}`;
    left = 8 + Math.min(width / 3, Math.max(0, ...names.map(name => c.measureText(name).width)));
    c.textBaseline = "middle";
    names.forEach((name, i) => {
      const y = i * lane;
      c.fillStyle = colour("soft");
      c.textAlign = "right";
      c.fillText(name, left - 8, y + lane / 2, left - 8);
      c.fillStyle = colour("line");
      c.globalAlpha = 0.45;
      c.fillRect(left, y + 1, width - left - RIGHT, lane - 2);
      c.globalAlpha = 1;
      episode.nodes.forEach((node, place) => {
        if (node.label !== name || node.kind !== "action") return;
        const {ticks, values} = episode.statuses[place];
        ticks.forEach((tick, k) => {
          if (values[k] === "." || values[k] === "x") return;
          const end = k + 1 < ticks.length ? ticks[k + 1] : episode.ticks;
          c.fillStyle = colour(paintOf(episode.paints[name] ?? -1));
          c.globalAlpha = values[k] === "f" ? 0.35 : 1;
          const high = values[k] === "f" ? lane * 0.35 : lane - 3;
          c.fillRect(x(tick), y + (lane - high) / 2, Math.max(1.2, Math.min(x(end), width - RIGHT) - x(tick)), high);
        });
      });
      c.globalAlpha = 1;
    });
    c.fillStyle = colour("soft");
    c.font = `10.5px ${FONT}`;
    c.textAlign = "center";
    for (const s of times(width - left - RIGHT)) c.fillText(timeText(s), x(s / episode.step), height - BOTTOM / 2 + 1);
  }

  function draw(tick) {
    let c;
    [c, width, height] = sharp(canvas);
    drawBackdrop(canvas.width / width);
    c.clearRect(0, 0, width, height);
    c.drawImage(backdrop, 0, 0, width, height);
    const at = x(Math.min(tick, span));
    c.fillStyle = colour("ink");
    c.fillRect(at - 1, 0, 2, height - BOTTOM);
    c.beginPath();
    c.arc(at, height - BOTTOM, 5, 0, 2 * Math.PI);
    c.fill();
    canvas.setAttribute("aria-valuenow", Math.floor(tick));
    canvas.setAttribute("aria-valuetext", seconds(Math.floor(tick)).toFixed(1) + " s");
  }
  canvas.setAttribute("aria-valuemax", episode.ticks - 1);
  return {canvas, draw, room, place: x, tickAt: px => Math.max(0, Math.min(span, (px - left) / (width - left - RIGHT) * span))};
})();
