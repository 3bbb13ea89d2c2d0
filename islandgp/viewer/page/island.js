// The island from above: what lies and walks there, and the robot with its path and sight.
const island = (() => {
  const canvas = document.getElementById("island");
  const view = {scale: 1, x: episode.side / 2, y: episode.side / 2, fitted: true, follow: false};
  const ground = document.createElement("canvas");  // what never changes, drawn once a view
  let groundOf = "";
  let width = 1, height = 1;

  const fit = () => {
    view.scale = Math.min(width, height) / (episode.side * 1.1);
    view.x = view.y = episode.side / 2;
    view.fitted = true;
  };
  const screen = (x, y) => [width / 2 + (x - view.x) * view.scale, height / 2 - (y - view.y) * view.scale];

  function zoom(factor, px = width / 2, py = height / 2) {
    const before = view.scale;
    view.scale = Math.min(60, Math.max(0.2, view.scale * factor));
    view.x += (px - width / 2) * (1 / before - 1 / view.scale);
    view.y -= (py - height / 2) * (1 / before - 1 / view.scale);
    view.fitted = false;
  }

  function disc(c, x, y, r, fill, stroke, line = 1.5) {
    c.beginPath();
    c.arc(x, y, r, 0, 2 * Math.PI);
    if (fill) { c.fillStyle = fill; c.fill(); }
    if (stroke) { c.strokeStyle = stroke; c.lineWidth = line; c.stroke(); }
  }

  function drawGround() {
    const key = [view.scale, view.x, view.y, width, height, colour("grass")].join();
    if (key === groundOf) return;
    groundOf = key;
    ground.width = canvas.width;
    ground.height = canvas.height;
    const c = ground.getContext("2d"), ratio = canvas.width / width, s = view.scale;
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    const sea = c.createLinearGradient(0, 0, 0, height);
    sea.addColorStop(0, colour("sea"));
    sea.addColorStop(1, colour("sea-deep"));
    c.fillStyle = sea;
    c.fillRect(0, 0, width, height);
    const [left, top] = screen(0, episode.side), side = episode.side * s;
    for (const [border, paint] of [[11, "sand"], [1, "grass"]]) {
      c.fillStyle = colour(paint);
      c.beginPath();
      c.roundRect(left - border * s, top - border * s, side + 2 * border * s, side + 2 * border * s,
        (border > 5 ? 20 : 7) * s);
      c.fill();
    }
    // A gentle relief: rings around the centre, every 30 m.
    c.save();
    c.beginPath();
    c.roundRect(left - s, top - s, side + 2 * s, side + 2 * s, 7 * s);
    c.clip();
    c.strokeStyle = colour("grass-deep");
    c.lineWidth = 1.4;
    for (let r = 30; r < episode.side; r += 30) {
      c.beginPath();
      for (let a = 0; a <= 120; a++) {
        const angle = a / 60 * Math.PI;
        const wave = r * (1 + 0.07 * Math.sin(3 * angle + r) + 0.05 * Math.sin(5 * angle - r / 40));
        const [x, y] = screen(episode.side / 2 + wave * Math.cos(angle), episode.side / 2 + wave * Math.sin(angle));
        if (a) c.lineTo(x, y); else c.moveTo(x, y);
      }
      c.stroke();
    }
    c.restore();
    // The round of the patrol, with its waypoints in order.
    c.strokeStyle = colour("patrol");
    c.globalAlpha = 0.35;
    c.lineWidth = 1.2;
    c.setLineDash([3, 5]);
    c.beginPath();
    episode.waypoints.forEach(([x, y], i) => { const p = screen(x, y); if (i) c.lineTo(...p); else c.moveTo(...p); });
    c.closePath();
    c.stroke();
    c.setLineDash([]);
    c.globalAlpha = 1;
    for (const [x, y, r] of episode.rocks) {
      const [px, py] = screen(x, y);
      disc(c, px + r * s * 0.12, py + r * s * 0.16, r * s, "rgba(0,0,0,0.10)");
      const shade = c.createRadialGradient(px - r * s * 0.4, py - r * s * 0.4, r * s * 0.1, px, py, r * s);
      shade.addColorStop(0, colour("rock-light"));
      shade.addColorStop(1, colour("rock"));
      disc(c, px, py, Math.max(1.5, r * s), shade);
    }
    const mark = Math.max(7, Math.min(15, 3.4 * s));
    episode.waypoints.forEach(([x, y], i) => sign(c, x, y, mark * 0.8, colour("patrol"), String(i + 1), "circle"));
    for (const [x, y] of episode.chargers) sign(c, x, y, mark, colour("battery"), "\u26a1\ufe0e", "circle");
    for (const [x, y] of episode.clearing) sign(c, x, y, mark, colour("delivery"), "\u2193", "square");
  }

  function sign(c, x, y, r, paint, text, shape) {
    const [px, py] = screen(x, y);
    c.fillStyle = paint;
    c.strokeStyle = colour("panel");
    c.lineWidth = 1.6;
    c.beginPath();
    if (shape === "circle") c.arc(px, py, r, 0, 2 * Math.PI);
    else c.roundRect(px - r, py - r, 2 * r, 2 * r, r * 0.35);
    c.fill();
    c.stroke();
    c.fillStyle = colour("panel");
    c.font = `bold ${Math.round(r * 1.15)}px system-ui, "DejaVu Sans", sans-serif`;
    c.textAlign = "center";
    c.textBaseline = "middle";
    c.fillText(text, px, py + r * 0.06);
  }

  function drawPath(c, tick) {
    const {every, x, y} = episode.robot, end = Math.floor(tick / every);
    const stretch = (from, to, line, alpha) => {
      if (to <= from) return;
      c.beginPath();
      for (let i = from; i <= to; i++) {
        const p = screen(x[i], y[i]);
        if (i === from) c.moveTo(...p); else c.lineTo(...p);
      }
      c.lineTo(...screen(...placeAt(episode.robot, tick)));
      c.globalAlpha = alpha;
      c.lineWidth = line;
      c.stroke();
    };
    c.strokeStyle = colour("robot");
    c.lineJoin = c.lineCap = "round";
    stretch(0, end, 1.1, 0.28);
    const recent = Math.round(25 / episode.step / every);
    for (let part = 0; part < 4; part++) {
      stretch(Math.max(0, end - Math.round(recent * (4 - part) / 4)), end, 1.2 + part * 0.5, 0.22);
    }
    c.globalAlpha = 1;
  }

  function drawGarbage(c, tick) {
    const r = Math.max(3.1, Math.min(8, 1.5 * view.scale));
    c.fillStyle = colour("garbage");
    c.strokeStyle = colour("panel");
    c.lineWidth = 0.8;
    c.beginPath();
    for (const item of episode.garbage) {
      if (tick < item.from || tick >= item.to) continue;
      const [x, y] = screen(item.x, item.y);
      c.moveTo(x, y - r);
      c.lineTo(x + r, y);
      c.lineTo(x, y + r);
      c.lineTo(x - r, y);
      c.closePath();
    }
    c.fill();
    c.stroke();
  }

  function drawHumanoids(c, tick) {
    const r = Math.max(4.6, Math.min(12, 1.7 * view.scale));
    c.textAlign = "center";
    c.textBaseline = "middle";
    episode.humanoids.forEach((way, h) => {
      const [x, y] = screen(...placeAt(way, tick)), items = episode.carried[h].at(tick);
      const asks = items >= episode.asks;
      if (asks) disc(c, x, y, r * 1.65, null, colour("humanoid"), 1.6);
      disc(c, x, y, r, asks ? colour("humanoid") : colour("panel"), colour("humanoid"), 1.8);
      c.fillStyle = asks ? colour("panel") : colour("humanoid");
      c.font = `bold ${Math.round(r * 1.25)}px system-ui, "DejaVu Sans", sans-serif`;
      c.fillText(String(items), x, y + 0.5);
    });
  }

  let heading = -Math.PI / 2;
  function drawRobot(c, tick) {
    const at = placeAt(episode.robot, tick), [x, y] = screen(...at);
    const sight = episode.perception * view.scale, goal = episode.goals.at(tick);
    const glow = c.createRadialGradient(x, y, 0, x, y, sight);
    glow.addColorStop(0, `rgba(${colour("sight")},0.26)`);
    glow.addColorStop(1, `rgba(${colour("sight")},0.10)`);
    disc(c, x, y, sight, glow, `rgba(${colour("sight")},0.75)`, 1.2);
    if (goal) {
      const [gx, gy] = screen(...goal);
      c.strokeStyle = colour("robot");
      c.globalAlpha = 0.75;
      c.lineWidth = 1.3;
      c.setLineDash([5, 4]);
      c.beginPath();
      c.moveTo(x, y);
      c.lineTo(gx, gy);
      c.stroke();
      c.setLineDash([]);
      disc(c, gx, gy, 4.5, null, colour("robot"), 1.5);
      c.globalAlpha = 1;
      if (Math.hypot(gx - x, gy - y) > 2) heading = Math.atan2(gy - y, gx - x);
    }
    const r = Math.max(6.5, Math.min(16, 2.3 * view.scale));
    c.save();
    c.translate(x, y);
    disc(c, 0, 0, r * 1.25, colour("panel"));
    disc(c, 0, 0, r, colour("robot"));
    c.rotate(heading);
    c.fillStyle = colour("panel");
    c.beginPath();
    c.moveTo(r * 0.72, 0);
    c.lineTo(-r * 0.42, r * 0.5);
    c.lineTo(-r * 0.12, 0);
    c.lineTo(-r * 0.42, -r * 0.5);
    c.fill();
    c.restore();
    const level = episode.board[0].at(tick) / 100;  // the battery, as a ring
    c.strokeStyle = colour("battery");
    c.lineWidth = 2.6;
    c.beginPath();
    c.arc(x, y, r * 1.5, -Math.PI / 2, -Math.PI / 2 + 2 * Math.PI * level);
    c.stroke();
  }

  // Points as they are won and lost rise above the robot; `window` in ticks.
  function drawCredits(c, tick, window) {
    c.textAlign = "center";
    c.textBaseline = "alphabetic";
    c.font = 'bold 13px system-ui, "DejaVu Sans", sans-serif';
    let row = 0;
    for (let i = lastBefore(creditTicks, tick); i >= 0 && creditTicks[i] > tick - window; i--) {
      const credit = episode.credits[i];
      if (credit.tick > tick || Math.abs(credit.points) < 20) continue;
      const age = (tick - credit.tick) / window;
      const [x, y] = screen(...placeAt(episode.robot, credit.tick));
      const text = (credit.points > 0 ? "+" : "\u2212") + points(Math.abs(credit.points));
      c.globalAlpha = 1 - age * age;
      c.lineWidth = 3.5;
      c.strokeStyle = colour("panel");
      c.strokeText(text, x, y - 18 - 26 * age - 15 * row);
      c.fillStyle = colour(episode.components[credit.component]);
      c.fillText(text, x, y - 18 - 26 * age - 15 * row);
      if (++row > 3) break;
    }
    c.globalAlpha = 1;
  }
  const creditTicks = episode.credits.map(credit => credit.tick);

  function draw(tick, window) {
    let c;
    [c, width, height] = sharp(canvas);
    if (view.fitted) fit();
    if (view.follow) [view.x, view.y] = placeAt(episode.robot, tick);
    drawGround();
    c.drawImage(ground, 0, 0, width, height);
    drawPath(c, tick);
    drawGarbage(c, tick);
    drawHumanoids(c, tick);
    drawRobot(c, tick);
    drawCredits(c, tick, window);
  }

  document.getElementById("legend").innerHTML = [
    ["robot", "robot, battery, sight"], ["garbage", "garbage"], ["humanoid", "humanoid (asks when filled)"],
    ["battery", "charger"], ["delivery", "clearing point"], ["patrol", "waypoint"], ["rock", "obstacle"],
  ].map(([paint, name]) => `<span><i style="background:var(--${paint})"></i>${name}</span>`).join("");

  return {canvas, view, draw, zoom, fit, moved(dx, dy) {
    view.x -= dx / view.scale;
    view.y += dy / view.scale;
    view.fitted = view.follow = false;
  }};
})();
