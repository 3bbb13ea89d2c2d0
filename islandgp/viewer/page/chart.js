// Fitness by component over time: a line each, drawn once, and a playhead.
const chart = (() => {
  const canvas = document.getElementById("chart"), table = document.getElementById("shares");
  const backdrop = document.createElement("canvas");
  const FONT = '10.5px system-ui, "DejaVu Sans", sans-serif';
  const RIGHT = 16, TOP = 6, BOTTOM = 18;
  let drawnFor = "", left = 46;
  const final = totals.sums[totals.sums.length - 1];
  const used = episode.components.map((component, i) => ({...component, i, paint: paintOf(i)}))
    .filter(({i}) => totals.sums.some(sums => sums[i] !== 0))
    .sort((a, b) => final[b.i] - final[a.i]);
  const low = Math.min(0, ...totals.sums.map(sums => Math.min(sumOf(sums), ...sums)));
  const most = Math.max(0, ...totals.sums.map(sums => Math.max(sumOf(sums), ...sums)));
  const high = most > low ? most : low + 1;

  const row = (paint, name, meaning) => `<td title="${escaped(meaning)}"><i style="background:var(--${paint})"></i>${escaped(name)}</td><td></td>`;
  table.innerHTML = used.map(({name, meaning, paint}) => `<tr>${row(paint, name, meaning)}</tr>`).join("") +
    `<tr class="total">${row("ink", "fitness", "the sum of the components")}</tr>`;
  const cells = [...table.querySelectorAll("td:last-child")], texts = cells.map(() => "");

  const x = (tick, width) => left + (width - left - RIGHT) * tick / Math.max(1, episode.ticks - 1);
  function drawBackdrop(width, height, ratio) {
    const key = [width, height, ratio, colour("ink")].join();
    if (key === drawnFor) return;
    drawnFor = key;
    backdrop.width = width * ratio;
    backdrop.height = height * ratio;
    const c = backdrop.getContext("2d"), by = marks(low, high, Math.min(5, height / 34));
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.font = FONT;
    const text = value => value.toLocaleString("en", {maximumFractionDigits: 6});
    left = 10 + Math.max(...by.map(value => c.measureText(text(value)).width));
    const y = value => height - BOTTOM - (height - TOP - BOTTOM) * (value - low) / (high - low);
    c.fillStyle = colour("soft");
    c.lineWidth = 1;
    c.textAlign = "right";
    c.textBaseline = "middle";
    for (const value of by) {
      c.strokeStyle = colour("line");
      c.beginPath();
      c.moveTo(left, y(value));
      c.lineTo(width - RIGHT, y(value));
      c.stroke();
      c.fillText(text(value), left - 6, y(value));
    }
    c.textBaseline = "top";
    c.textAlign = "center";
    for (const s of times(width - left - RIGHT)) c.fillText(timeText(s), x(s / episode.step, width), height - BOTTOM + 4);
    c.lineJoin = "round";
    const curve = (paint, line, value) => {
      c.strokeStyle = colour(paint);
      c.lineWidth = line;
      c.beginPath();
      c.moveTo(x(0, width), y(0));
      totals.ticks.forEach((tick, i) => {
        if (tick < 0) return;
        c.lineTo(x(tick, width), y(value(totals.sums[i - 1])));
        c.lineTo(x(tick, width), y(value(totals.sums[i])));
      });
      c.lineTo(x(episode.ticks - 1, width), y(value(final)));
      c.stroke();
    };
    for (const {paint, i} of used) {
      if (i >= PAINTS) c.setLineDash([5, 3]);  // the colours come a second time
      curve(paint, 1.8, sums => sums[i]);
      c.setLineDash([]);
    }
    curve("ink", 2.4, sumOf);
  }

  function draw(tick) {
    const [c, width, height] = sharp(canvas);
    drawBackdrop(width, height, canvas.width / width);
    c.clearRect(0, 0, width, height);
    c.drawImage(backdrop, 0, 0, width, height);
    const at = x(Math.min(episode.ticks - 1, tick), width);
    c.fillStyle = colour("panel");
    c.globalAlpha = 0.62;
    c.fillRect(at, 0, width - at, height - BOTTOM);
    c.globalAlpha = 1;
    c.fillStyle = colour("ink");
    c.fillRect(at - 0.75, TOP, 1.5, height - TOP - BOTTOM);
    const sums = totals.at(Math.floor(tick));
    [...used.map(({i}) => sums[i]), sumOf(sums)].forEach((value, i) => {
      const text = points(value);
      if (text !== texts[i]) cells[i].textContent = texts[i] = text;
    });
    return sumOf(sums);
  }
  return {draw};
})();
