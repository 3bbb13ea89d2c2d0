// The world from above: things that stay, come, go and move; or pictures that a simulator made.
// null where the domain draws nothing.
const scene = (() => {
  const world = episode.scene, panel = document.getElementById("map");
  if (!world) {
    panel.remove();
    document.body.classList.add("no-scene");
    return null;
  }
  const canvas = document.getElementById("scene");
  const view = {scale: 1, x: 0, y: 0, fitted: true, follow: false};
  const ground = document.createElement("canvas");  // what never changes, drawn once a view
  const robot = world.movers[world.movers.length - 1];  // the last one is on top, and followed
  const LEAST = {fixed: world.fixed.length > 200 ? 2 : 5, item: 3.2, mover: 5, robot: 10};  // px of a thing's radius
  const hooks = {ready: () => {}};
  let groundOf = "", width = 1, height = 1;

  const images = world.frames.map(frame => {
    const image = new Image();
    image.onload = () => {
      if (!world.width) [world.width, world.height] = [image.naturalWidth, image.naturalHeight];
      hooks.ready();
    };
    image.src = "data:image/png;base64," + frame;
    return image;
  });

  const fitScale = () => Math.min(width / (world.width || 1), height / (world.height || world.width || 1)) / 1.07;
  function fit() {
    view.scale = fitScale();
    view.x = world.width / 2;
    view.y = world.height / 2;
    view.fitted = true;
  }
  const screen = (x, y) => [width / 2 + (x - view.x) * view.scale, height / 2 - (y - view.y) * view.scale];

  function zoom(factor, px = width / 2, py = height / 2) {
    const before = view.scale, whole = fitScale();
    view.scale = Math.min(whole * 40, Math.max(whole / 4, view.scale * factor));
    view.x += (px - width / 2) * (1 / before - 1 / view.scale);
    view.y -= (py - height / 2) * (1 / before - 1 / view.scale);
    view.fitted = false;
  }

  // Each shape as a path around 0, 0 with radius r; a triangle points to the right.
  const SHAPES = {
    circle: r => { const p = new Path2D(); p.arc(0, 0, r, 0, 2 * Math.PI); return p; },
    ring: r => SHAPES.circle(r),
    square: r => { const p = new Path2D(); p.roundRect(-r * 0.9, -r * 0.9, r * 1.8, r * 1.8, r * 0.3); return p; },
    diamond: r => new Path2D(`M0 ${-r}L${r} 0L0 ${r}L${-r} 0Z`),
    triangle: r => new Path2D(`M${r * 1.1} 0L${-r * 0.8} ${r * 0.8}L${-r * 0.4} 0L${-r * 0.8} ${-r * 0.8}Z`),
    cross: r => new Path2D(`M${-r * 0.7} ${-r * 0.7}L${r * 0.7} ${r * 0.7}M${r * 0.7} ${-r * 0.7}L${-r * 0.7} ${r * 0.7}`),
  };
  const UP = -Math.PI / 2;

  function shape(c, style, x, y, r, heading = UP) {
    c.save();
    c.translate(x, y);
    if (style.shape === "triangle") c.rotate(heading);
    const path = SHAPES[style.shape](r);
    c.fillStyle = c.strokeStyle = style.colour;
    if (style.shape === "cross") {
      c.lineCap = "round";
      c.lineWidth = Math.max(1.8, Math.min(4, r * 0.3));
      c.stroke(path);
    } else if (style.shape === "ring") {
      c.globalAlpha = 0.13;
      c.fill(path);
      c.globalAlpha = 0.8;
      c.lineWidth = 1.4;
      c.stroke(path);
    } else {
      c.fill(path);
      c.strokeStyle = colour("panel");
      c.lineWidth = Math.min(1.6, r * 0.25);
      c.stroke(path);
    }
    c.restore();
  }

  // White or black, whichever can be read better on a colour.
  const inks = {};
  function inkOn(paint) {
    return inks[paint] ??= (() => {
      const c = document.createElement("canvas").getContext("2d");
      c.fillStyle = paint;
      c.fillRect(0, 0, 1, 1);
      const [r, g, b] = c.getImageData(0, 0, 1, 1).data;
      return 0.299 * r + 0.587 * g + 0.114 * b > 150 ? "#111" : "#fff";
    })();
  }
  const FILLED = ["circle", "square", "diamond"];
  const FONT = 'system-ui, "DejaVu Sans", sans-serif';

  // A short text is drawn on its thing if that is large enough, otherwise beside it.
  function write(c, {style, text}, x, y, r) {
    if (!text) return;
    c.textBaseline = "middle";
    if (FILLED.includes(style.shape) && text.length <= 2 && r >= 6) {
      c.font = `bold ${Math.min(16, Math.round(r * (text.length > 1 ? 1.1 : 1.4)))}px ${FONT}`;
      c.textAlign = "center";
      c.fillStyle = inkOn(style.colour);
      c.fillText(text, x, y + 0.5);
      return;
    }
    c.font = `bold 11px ${FONT}`;
    c.textAlign = "left";
    c.lineWidth = 3;
    c.lineJoin = "round";
    c.strokeStyle = colour("panel");
    c.fillStyle = colour("ink");
    c.strokeText(text, x + r + 2, y);
    c.fillText(text, x + r + 2, y);
  }

  function place(c, thing, x, y, least, heading) {
    const roomy = thing.text && thing.text.length <= 2 && FILLED.includes(thing.style.shape);
    const r = Math.max(roomy ? 6.5 : least, thing.size * view.scale);
    shape(c, thing.style, x, y, r, heading);
    write(c, thing, x, y, r);
  }

  function drawGround() {
    const key = [view.scale, view.x, view.y, width, height, colour("floor")].join();
    if (key === groundOf) return;
    groundOf = key;
    ground.width = canvas.width;
    ground.height = canvas.height;
    const c = ground.getContext("2d"), ratio = canvas.width / width, s = view.scale;
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.fillStyle = colour("around");
    c.fillRect(0, 0, width, height);
    const [left, top] = screen(0, world.height);
    c.save();
    c.beginPath();
    c.roundRect(left - 2, top - 2, world.width * s + 4, world.height * s + 4, 6);
    c.fillStyle = colour("floor");
    c.fill();
    c.strokeStyle = colour("line");
    c.stroke();
    c.clip();
    c.strokeStyle = colour("grid");
    c.lineWidth = 1;
    c.beginPath();
    for (const x of marks(0, world.width, 10 * world.width / Math.max(world.width, world.height))) {
      const [px] = screen(x, 0);
      c.moveTo(px, 0);
      c.lineTo(px, height);
    }
    for (const y of marks(0, world.height, 10 * world.height / Math.max(world.width, world.height))) {
      const [, py] = screen(0, y);
      c.moveTo(0, py);
      c.lineTo(width, py);
    }
    if (!images.length) c.stroke();
    c.restore();
    for (const thing of world.fixed) place(c, thing, ...screen(thing.x, thing.y), LEAST.fixed);
  }

  function drawFrame(c, tick) {
    const image = images[world.shown.at(tick)];
    if (!image || !image.complete || !image.naturalWidth) return;
    const s = Math.min(world.width / image.naturalWidth, world.height / image.naturalHeight) * view.scale;
    const [x, y] = screen(world.width / 2, world.height / 2);
    const [w, h] = [image.naturalWidth * s, image.naturalHeight * s];
    c.imageSmoothingEnabled = s < 1;
    c.drawImage(image, x - w / 2, y - h / 2, w, h);
  }

  // The robot's way so far: all of it thin, the last part thicker.
  function drawPath(c, tick) {
    const {way} = robot, end = lastBefore(way.ticks, tick), now = screen(...placeAt(way, tick));
    const stretch = (since, line, alpha) => {
      c.beginPath();
      c.moveTo(...screen(...placeAt(way, since)));
      for (let i = lastBefore(way.ticks, since) + 1; i <= end; i++) c.lineTo(...screen(way.x[i], way.y[i]));
      c.lineTo(...now);
      c.globalAlpha = alpha;
      c.lineWidth = line;
      c.stroke();
    };
    c.strokeStyle = robot.look(tick).style.colour;
    c.lineJoin = c.lineCap = "round";
    stretch(0, 1.2, 0.38);
    const recent = 0.06 * episode.ticks;
    for (let part = 0; part < 4; part++) stretch(Math.max(0, tick - recent * (4 - part) / 4), 1.3 + part * 0.6, 0.25);
    c.globalAlpha = 1;
  }

  // Where a mover looks to: along its last stretch that was not on the spot.
  function headingAt({ticks, x, y}, tick) {
    for (let i = Math.min(lastBefore(ticks, tick), ticks.length - 2); i >= 0; i--) {
      if (x[i] !== x[i + 1] || y[i] !== y[i + 1]) return Math.atan2(y[i] - y[i + 1], x[i + 1] - x[i]);
    }
    return UP;
  }

  function drawMovers(c, tick) {
    for (const mover of world.movers) {
      const look = mover.look(Math.floor(tick)), [x, y] = screen(...placeAt(mover.way, tick));
      place(c, look, x, y, mover === robot ? LEAST.robot : LEAST.mover, headingAt(mover.way, tick));
    }
  }

  // Points as they are won and lost rise above the robot; `window` in ticks.
  const creditTicks = episode.credits.map(credit => credit.tick);
  const large = Math.max(...totals.sums.map(sums => Math.max(...sums.map(Math.abs)))) / 2000;
  function drawCredits(c, tick, window) {
    if (!creditTicks.length) return;
    c.textAlign = "center";
    c.textBaseline = "alphabetic";
    c.font = `bold 13px ${FONT}`;
    let row = 0;
    for (let i = lastBefore(creditTicks, tick); i >= 0 && creditTicks[i] > tick - window; i--) {
      const credit = episode.credits[i];
      if (credit.tick > tick || Math.abs(credit.points) < large) continue;
      const age = (tick - credit.tick) / window;
      const [x, y] = robot ? screen(...placeAt(robot.way, credit.tick)) : [width / 2, 64];
      const text = (credit.points > 0 ? "+" : "\u2212") + points(Math.abs(credit.points));
      c.globalAlpha = 1 - age * age;
      c.lineWidth = 3.5;
      c.strokeStyle = colour("panel");
      c.strokeText(text, x, y - 18 - 26 * age - 15 * row);
      c.fillStyle = colour(paintOf(credit.component));
      c.fillText(text, x, y - 18 - 26 * age - 15 * row);
      if (++row > 3) break;
    }
    c.globalAlpha = 1;
  }

  function draw(tick, window) {
    let c;
    [c, width, height] = sharp(canvas);
    if (view.fitted) fit();
    if (view.follow) [view.x, view.y] = placeAt(robot.way, tick);
    drawGround();
    c.drawImage(ground, 0, 0, width, height);
    if (images.length) drawFrame(c, Math.floor(tick));
    if (robot) drawPath(c, tick);
    const now = Math.floor(tick);
    for (const item of world.items) {
      if (item.from <= now && now < item.to) place(c, item, ...screen(item.x, item.y), LEAST.item);
    }
    drawMovers(c, tick);
    drawCredits(c, tick, window);
  }

  const SIGNS = {
    circle: "<circle r='5'/>", ring: "<circle r='5' class='open'/>", square: "<rect x='-5' y='-5' width='10' height='10' rx='2'/>",
    diamond: "<path d='M0-6L6 0L0 6L-6 0Z'/>", triangle: "<path d='M0-6L5 5L0 3L-5 5Z'/>", cross: "<path class='open' d='M-4-4L4 4M4-4L-4 4'/>",
  };
  document.getElementById("legend").innerHTML = world.styles.map(({meaning, shape: sign, colour: paint}) =>
    `<span><svg viewBox="-7 -7 14 14" aria-hidden="true" style="color:${escaped(paint)}">${SIGNS[sign]}</svg>${escaped(meaning)}</span>`).join("");
  if (!world.styles.length) document.getElementById("legend").remove();
  if (!robot) document.getElementById("follow").remove();

  return {canvas, view, draw, zoom, fit, hooks, robot,
    follow(on) {
      view.follow = on;
      if (on) { view.fitted = false; view.scale = Math.max(view.scale, fitScale() * 3.5); }
    },
    moved(dx, dy) {
      view.x -= dx / view.scale;
      view.y += dy / view.scale;
      view.fitted = view.follow = false;
    }};
})();
