// Fitness by component over time: a line each, drawn once, and a playhead.
const chart = (() => {
  const canvas = document.getElementById("chart"), table = document.getElementById("shares");
  const backdrop = document.createElement("canvas");
  const PAD = {left: 46, right: 16, top: 6, bottom: 18};
  let drawnFor = "";
  const final = totals.sums[totals.sums.length - 1];
  const used = episode.components.map((name, i) => ({name, i}))
    .filter(({i}) => totals.sums.some(sums => sums[i] !== 0))
    .sort((a, b) => final[b.i] - final[a.i]);
  const all = sums => sums.reduce((a, b) => a + b, 0);
  const low = Math.min(0, ...totals.sums.map(sums => Math.min(all(sums), ...sums)));
  const high = Math.max(100, ...totals.sums.map(sums => Math.max(all(sums), ...sums)));

  table.innerHTML = used.map(({name}) =>
    `<tr><td><i style="background:var(--${name})"></i>${name}</td><td></td></tr>`).join("") +
    '<tr class="total"><td><i style="background:var(--ink)"></i>fitness</td><td></td></tr>';
  const cells = [...table.querySelectorAll("td:last-child")], texts = cells.map(() => "");

  function step(range) {
    const rough = range / 4, power = 10 ** Math.floor(Math.log10(rough));
    return power * [1, 2, 5, 10].find(m => m * power >= rough);
  }
  function drawBackdrop(width, height, ratio) {
    const key = [width, height, ratio, colour("ink")].join();
    if (key === drawnFor) return;
    drawnFor = key;
    backdrop.width = width * ratio;
    backdrop.height = height * ratio;
    const c = backdrop.getContext("2d");
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    const x = tick => PAD.left + (width - PAD.left - PAD.right) * tick / Math.max(1, episode.ticks - 1);
    const y = value => height - PAD.bottom - (height - PAD.top - PAD.bottom) * (value - low) / (high - low);
    c.font = '10.5px system-ui, "DejaVu Sans", sans-serif';
    c.fillStyle = colour("soft");
    c.lineWidth = 1;
    const by = step(high - low);
    c.textAlign = "right";
    c.textBaseline = "middle";
    for (let value = Math.ceil(low / by) * by; value <= high; value += by) {
      c.strokeStyle = colour("line");
      c.beginPath();
      c.moveTo(PAD.left, y(value));
      c.lineTo(width - PAD.right, y(value));
      c.stroke();
      c.fillText((value || 0).toLocaleString("en"), PAD.left - 6, y(value));
    }
    c.textBaseline = "top";
    c.textAlign = "center";
    const apart = x(60 / episode.step) - x(0) > 44 ? 60 : 120;
    for (let s = 0; s <= seconds(episode.ticks); s += apart) c.fillText(s + " s", x(s / episode.step), height - PAD.bottom + 4);
    c.lineJoin = "round";
    const curve = (paint, line, value) => {
      c.strokeStyle = colour(paint);
      c.lineWidth = line;
      c.beginPath();
      c.moveTo(x(0), y(0));
      totals.ticks.forEach((tick, i) => {
        if (tick < 0) return;
        c.lineTo(x(tick), y(value(totals.sums[i - 1])));
        c.lineTo(x(tick), y(value(totals.sums[i])));
      });
      c.lineTo(x(episode.ticks - 1), y(value(final)));
      c.stroke();
    };
    for (const {name, i} of used) curve(name, 1.8, sums => sums[i]);
    curve("ink", 2.4, all);
  }

  function draw(tick) {
    const [c, width, height] = sharp(canvas);
    drawBackdrop(width, height, canvas.width / width);
    c.clearRect(0, 0, width, height);
    c.drawImage(backdrop, 0, 0, width, height);
    const x = PAD.left + (width - PAD.left - PAD.right) * Math.min(1, tick / Math.max(1, episode.ticks - 1));
    c.fillStyle = colour("panel");
    c.globalAlpha = 0.62;
    c.fillRect(x, 0, width - x, height - PAD.bottom);
    c.globalAlpha = 1;
    c.fillStyle = colour("ink");
    c.fillRect(x - 0.75, PAD.top, 1.5, height - PAD.top - PAD.bottom);
    const sums = totals.at(Math.floor(tick));
    [...used.map(({i}) => sums[i]), all(sums)].forEach((value, i) => {
      const text = points(value);
      if (text !== texts[i]) cells[i].textContent = texts[i] = text;
    });
    return all(sums);
  }
  return {draw};
})();
