// The course of the episode: a lane for each action, with what it earned, and the playhead.
const timeline = (() => {
  const canvas = document.getElementById("timeline"), backdrop = document.createElement("canvas");
  const PAINTS = {MoveToGarbage: "garbage", PickupGarbage: "garbage", SeekCharger: "battery",
    ExecuteCharge: "battery", MoveToHumanoid: "humanoid", DeliverToClearingPoint: "delivery",
    PatrolWaypoint: "patrol"};
  const names = [...new Set(episode.nodes.filter(node => node.kind === "action").map(node => node.label))];
  const LEFT = 172, RIGHT = 18, BOTTOM = 16;
  const span = Math.max(1, episode.ticks - 1);
  let drawnFor = "", width = 1, height = 1;
  const x = tick => LEFT + (width - LEFT - RIGHT) * tick / span;

  function drawBackdrop(ratio) {
    const key = [width, height, ratio, colour("ink")].join();
    if (key === drawnFor) return;
    drawnFor = key;
    backdrop.width = width * ratio;
    backdrop.height = height * ratio;
    const c = backdrop.getContext("2d"), lane = (height - BOTTOM) / Math.max(1, names.length);
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.font = `${Math.min(12, Math.max(8, lane - 2))}px system-ui, "DejaVu Sans", sans-serif`;
    c.textBaseline = "middle";
    names.forEach((name, i) => {
      const y = i * lane;
      c.textAlign = "right";
      c.fillStyle = colour("soft");
      c.fillText(name, LEFT - 8, y + lane / 2);
      c.fillStyle = colour("line");
      c.globalAlpha = 0.45;
      c.fillRect(LEFT, y + 1, width - LEFT - RIGHT, lane - 2);
      c.globalAlpha = 1;
      episode.nodes.forEach((node, place) => {
        if (node.label !== name || node.kind !== "action") return;
        const {ticks, values} = episode.statuses[place];
        ticks.forEach((tick, k) => {
          if (values[k] === "." || values[k] === "x") return;
          const end = k + 1 < ticks.length ? ticks[k + 1] : episode.ticks;
          c.fillStyle = colour(PAINTS[name] ?? "soft");
          c.globalAlpha = values[k] === "f" ? 0.35 : 1;
          const high = values[k] === "f" ? lane * 0.35 : lane - 3;
          c.fillRect(x(tick), y + (lane - high) / 2, Math.max(1.2, x(end) - x(tick)), high);
        });
      });
      c.globalAlpha = 1;
    });
    c.fillStyle = colour("soft");
    c.font = '10.5px system-ui, "DejaVu Sans", sans-serif';
    c.textAlign = "center";
    const every = seconds(episode.ticks) > 120 ? 30 : 10;
    for (let s = 0; s <= seconds(episode.ticks); s += every) c.fillText(s + " s", x(s / episode.step), height - BOTTOM / 2 + 1);
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
  }
  return {canvas, draw, tickAt: px => Math.max(0, Math.min(span, (px - LEFT) / (width - LEFT - RIGHT) * span))};
})();
