// The blackboard: each key's value now, and its whole course with the numbers the tree asks for.
const board = (() => {
  const section = document.getElementById("blackboard"), H = 20;
  const span = Math.max(1, episode.ticks - 1);
  const rows = episode.board.map(entry => {
    const known = entry.values.filter(value => value !== null);
    const low = entry.flag ? 0 : Math.min(entry.low, ...known, ...entry.marks);
    const most = entry.flag ? 1 : entry.most ?? (Math.max(low, ...known, ...entry.marks) || 1);
    const y = value => H - 1 - (H - 2) * Math.min(1, Math.max(0, ((value ?? low) - low) / (most - low || 1)));
    let line = "";
    entry.ticks.forEach((tick, i) => {
      const x = 100 * tick / span;
      line += i ? `H${x.toFixed(2)}V${y(entry.values[i]).toFixed(1)}` : `M${x} ${y(entry.values[i]).toFixed(1)}`;
    });
    line += "H100";
    const row = document.createElement("div");
    row.className = "entry";
    row.title = entry.meaning;
    row.innerHTML = `<div class="name"><span>${escaped(entry.key)}</span><b></b></div>` +
      `<svg viewBox="0 0 100 ${H}" preserveAspectRatio="none" aria-hidden="true"><path class="area" d="${line}V${H}H0Z"/>` +
      entry.marks.map(m => `<line class="mark" x1="0" x2="100" y1="${y(m)}" y2="${y(m)}"/>`).join("") +
      `<path class="past" d="${line}"/><line class="now" y1="0" y2="${H}"/></svg>`;
    section.append(row);
    // As many digits as the key ever has, so that the number does not jump about.
    const digits = Math.max(0, ...known.map(value => (String(value).split(".")[1] ?? "").length));
    return {entry, row, digits, value: row.querySelector("b"), now: row.querySelector(".now"), text: ""};
  });

  function draw(tick) {
    const x = String(100 * Math.min(1, tick / span));
    for (const row of rows) {
      const value = row.entry.at(Math.floor(tick));
      const text = row.entry.flag ? (value ? "yes" : "no") : row.entry.words[value] ?? (value === null ? "?" : value.toFixed(row.digits));
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
