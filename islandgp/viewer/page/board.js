// The blackboard: each key's value now, and its whole course with the numbers the tree asks for.
const board = (() => {
  const section = document.getElementById("blackboard"), H = 20;
  const span = Math.max(1, episode.ticks - 1);
  const rows = episode.board.map(entry => {
    const most = entry.flag ? 1 : entry.key === "batteryLevel" ? 100 : entry.key === "robotCurrentExtraCapacity"
      ? episode.capacity : Math.max(1, ...entry.values, ...entry.marks);
    const y = value => H - 1 - (H - 2) * Math.min(1, Math.max(0, value / most));
    let line = "";
    entry.ticks.forEach((tick, i) => {
      const x = 100 * tick / span;
      line += i ? `H${x.toFixed(2)}V${y(entry.values[i]).toFixed(1)}` : `M${x} ${y(entry.values[i]).toFixed(1)}`;
    });
    line += "H100";
    const row = document.createElement("div");
    row.className = "entry";
    row.title = entry.meaning;
    row.innerHTML = `<div class="name"><span>${entry.key}</span><b></b></div>` +
      `<svg viewBox="0 0 100 ${H}" preserveAspectRatio="none"><path class="area" d="${line}V${H}H0Z"/>` +
      entry.marks.map(m => `<line class="mark" x1="0" x2="100" y1="${y(m)}" y2="${y(m)}"/>`).join("") +
      `<path class="past" d="${line}"/><line class="now" y1="0" y2="${H}"/></svg>`;
    section.append(row);
    return {entry, row, value: row.querySelector("b"), now: row.querySelector(".now"), text: ""};
  });

  function draw(tick) {
    const x = String(100 * Math.min(1, tick / span));
    for (const row of rows) {
      const value = row.entry.at(Math.floor(tick));
      const text = row.entry.flag ? (value ? "yes" : "no") : row.entry.key === "batteryLevel"
        ? value.toFixed(1) + " %" : String(value);
      if (text !== row.text) {
        row.value.textContent = row.text = text;
        row.row.classList.toggle("yes", row.entry.flag && value > 0);
      }
      row.now.setAttribute("x1", x);
      row.now.setAttribute("x2", x);
    }
  }
  return {draw};
})();
