if (DATA.charts) {
  const C = DATA.charts, byNumber = new Map(C.branches.map((b) => [b.number, b]));
  const growing = C.branches.filter((b) => b.grows).sort((a, b) => largest(b.re) - largest(a.re));
  const colour = new Map(growing.map((b, i) => [b.number, COLOURS[i % COLOURS.length]]));
  const per = largest(C.branches.flatMap((b) => b.hz), 0) >= 2000 ? 1000 : 1, unit = per === 1000 ? "kHz" : "Hz";
  const scaled = (hz) => hz.map((f) => (f === null ? null : f / per));
  let at = C.values.length - 1;
  const narrow = () => window.innerWidth < 700;

  const rate = (b, i, unit = "") => b.rate[i] + unit + (b.uncertainty[i] === null ? ", mesh: ?" : "");
  const hover = (b, i) => plain(`${b.name.split(",")[0]}: ${digits(b.hz[i])} Hz, Re λ = ${rate(b, i, " 1/s")}, ` +
    `ζ = ${digits(b.ratio[i] === null ? null : 100 * b.ratio[i], 3)} %`) + "<br>" +
    plain([b.diameters[i], b.way[i], b.body[i]].filter(Boolean).join(", "));
  const texts = (b) => b.value.map((v, i) => plain(`${C.symbol} = ${digits(v)}`) + "<br>" + hover(b, i));
  const axisOfParameter = { title: { text: plain(C.label) }, type: C.logarithmic ? "log" : "linear", zeroline: false, exponentformat: "power",
    range: C.logarithmic ? [Math.log10(C.values[0]), Math.log10(C.values[C.values.length - 1])] : spread(C.values[0], C.values[C.values.length - 1]) };
  function spread(from, to) {
    const pad = 0.02 * (to - from) || 0.1 * Math.abs(from) || 0.1;
    return [from - pad, to + pad];
  }
  const base = { margin: { l: 62, r: 12, t: 26, b: 48 }, hovermode: "closest", paper_bgcolor: "#fff", plot_bgcolor: "#fff",
    font: { size: 13, color: "#1d2329" }, legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0 } };
  const grid = { gridcolor: "#e6eaee", linecolor: "#51606e", mirror: true };

  function stabilityTraces() {
    const lines = [], dots = [];
    for (const b of C.branches) {
      const style = { color: colour.get(b.number) || "#9aa5af", width: 1 };
      const axes = { xaxis: "x", yaxis: "y2" }, shared = { mode: "lines", hoverinfo: "skip", showlegend: false };
      lines.push({ ...shared, x: b.line[0], y: scaled(b.line[1]), line: { ...style, color: "#9aa5af" } });
      if (b.grows) {
        lines.push({ ...shared, ...axes, x: b.growth[0], y: b.growth[1], line: style });
        lines.push({ ...shared, x: b.thick[0], y: scaled(b.thick[1]), line: { ...style, width: 4 } });
        lines.push({ ...shared, ...axes, x: b.thickGrowth[0], y: b.thickGrowth[1], line: { ...style, width: 4 } });
      }
      const marker = { size: b.grows ? 5 : 3, color: colour.get(b.number) || "#7d8994" };
      const point = { mode: "markers", marker, text: texts(b), hovertemplate: "%{text}<extra></extra>",
        customdata: b.value.map(() => b.number), showlegend: false };
      dots.push({ ...point, x: b.value, y: scaled(b.hz) });
      if (b.grows) dots.push({ ...point, ...axes, x: b.value, y: b.re,
        error_y: { type: "data", array: b.bar, width: 0, thickness: 1.5, color: marker.color } });
    }
    const marks = [], told = (o) => [o.text, o.law, o.mesh].filter(Boolean).map(plain).join("<br>");
    const mark = (name, own, marker, text) => { if (own.length) marks.push({ mode: "markers", name, marker, x: own.map((o) => o.value),
      y: scaled(own.map((o) => o.hz)), customdata: own.map((o) => o.branches[0]), ...text }); };
    for (const [kind, into, symbol, name] of [["flutter", true, "circle", "flutter begins"],
      ["flutter", false, "circle-open", "flutter ends"], ["divergence", true, "square", "divergence begins"],
      ["divergence", false, "square-open", "divergence ends"]]) {
      const own = C.onsets.filter((o) => o.kind === kind && o.into === into && !o.parting && o.mesh !== "refined only");
      mark(name, own, { symbol, size: 11, color: "#000", line: { width: 2 } }, { text: own.map(told), hovertemplate: "%{text}<extra></extra>" });
    }
    const parting = C.onsets.filter((o) => o.parting && o.mesh !== "refined only");
    mark("growing modes meet or part", parting, { symbol: "triangle-down-open", size: 11, color: "#000", line: { width: 2 } },
      { text: parting.map(told), hovertemplate: "%{text}<extra></extra>" });
    const alone = C.onsets.filter((o) => o.mesh === "refined only"), gone = C.onsets.filter((o) => o.mesh === "vanishes refined");
    mark("on the refined mesh alone", alone, { symbol: "diamond-open", size: 11, color: "#7d8994", line: { width: 2 } },
      { text: alone.map(told), hovertemplate: "%{text}<extra></extra>" });
    mark("vanishes on the refined mesh", gone, { symbol: "x-thin", size: 20, line: { width: 2, color: "#7d8994" } }, { hoverinfo: "skip" });
    for (const m of C.measured) {
      marks.push({ mode: "lines", x: [C.values[0], C.values[C.values.length - 1]], y: [m.frequency_hz / per, m.frequency_hz / per],
        line: { color: "#b3261e", width: 1.5, dash: "dot" }, name: plain(measuredName(m)), hoverinfo: "name" });
    }
    return [...lines, ...dots, ...marks,
      { mode: "lines", x: [], y: [], line: { color: "rgba(240,165,0,.45)", width: 12 }, hoverinfo: "skip", showlegend: false },
      { mode: "lines", x: [], y: [], xaxis: "x", yaxis: "y2", line: { color: "rgba(240,165,0,.45)", width: 12 }, hoverinfo: "skip", showlegend: false }];
  }

  function measuredName(m) {
    const level = m.level_db === null || m.level_db === undefined ? "" : `, ${digits(m.level_db, 3)} dB`;
    return `measured: ${m.label ? m.label + ", " : ""}${digits(m.frequency_hz)} Hz${level}`;
  }

  /** Labels of onsets that cover neither each other nor another onset's dot, and whose lines do not cross; the others
   *  have theirs on hovering. */
  function labelsOfOnsets() {
    const layout = stability._fullLayout, x = layout.xaxis, y = layout.yaxis, taken = [];
    const dots = C.onsets.map((o) => [x.d2p(o.value), y.d2p(o.hz / per)]);
    const meets = (p, q) => p[0] < q[2] && q[0] < p[2] && p[1] < q[3] && q[1] < p[3];
    const side = (p, q, r) => Math.sign((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]));
    const cross = ([a, b], [c, d]) => side(a, b, c) * side(a, b, d) < 0 && side(c, d, a) * side(c, d, b) < 0;
    const along = [0.2, 0.4, 0.6, 0.8, 1];
    const passes = ([a, b], [l, t, r, m]) => along.some((s) => {
      const x = a[0] + s * (b[0] - a[0]), y = a[1] + s * (b[1] - a[1]);
      return x > l && x < r && y > t && y < m;
    });
    const labels = [], leaders = [];
    C.onsets.forEach((o, i) => {
      const text = (C.symbol.length > 3 ? `${digits(o.value)}, ${o.text.split(", ").pop()}` : o.text) + (o.mesh ? `, ${o.mesh}` : "");
      const width = 6.6 * text.length + 8, [px, py] = dots[i];
      for (const [ax, ay] of [[26, -24], [26, 24], [-26, -24], [-26, 24], [40, -46], [-40, -46], [40, 46], [-40, 46]]) {
        const left = ax > 0 ? px + ax : px + ax - width, box = [left, py + ay - 9, left + width, py + ay + 9];
        const inside = box[0] > 2 && box[2] < x._length - 2 && box[1] > 2 && box[3] < y._length - 2;
        const hidden = dots.some(([qx, qy], k) => k !== i && meets(box, [qx - 7, qy - 7, qx + 7, qy + 7]));
        const leader = [[px, py], [px + ax, py + ay]];
        const covered = taken.some((other) => meets(box, other) || passes(leader, other));
        if (!inside || hidden || covered || leaders.some((other) => cross(leader, other) || passes(other, box))) continue;
        taken.push(box);
        leaders.push(leader);
        labels.push({ xref: "x", yref: "y", x: C.logarithmic ? Math.log10(o.value) : o.value, y: o.hz / per, text: plain(text),
          showarrow: true, arrowhead: 0, arrowwidth: 1, ax, ay, xanchor: ax > 0 ? "left" : "right", font: { size: 12 },
          bgcolor: "rgba(255,255,255,.8)" });
        break;
      }
    });
    return labels;
  }

  function labelOfRange() {
    return C.rangeEnds.length ? [{ xref: "paper", yref: "y", x: 1, y: largest(C.rangeEnds) / per, xanchor: "right", yanchor: "bottom", showarrow: false,
      text: C.rangeText, font: { size: 11, color: "#51606e" } }] : [];
  }

  const floorOfGrowth = largest(growing.flatMap((b) => b.re), 0);
  const topOfBars = growing.reduce((most, b) => b.re.reduce((top, r, i) => Math.max(top, r + (b.bar[i] || 0)), most), 0);
  const shapesOfChart = C.rangeEnds.map((hz) => ({ type: "line", xref: "paper", x0: 0, x1: 1, y0: hz / per, y1: hz / per,
    line: { color: "#51606e", width: 1, dash: "dash" } }));
  const stability = document.getElementById("stability");
  const mostHz = largest([...C.branches.flatMap((b) => b.hz), ...C.onsets.map((o) => o.hz), ...C.measured.map((m) => m.frequency_hz), ...C.rangeEnds], 0) / per;
  Plotly.newPlot(stability, stabilityTraces(), { ...base, annotations: labelOfRange(), shapes: shapesOfChart,
    xaxis: { ...grid, ...axisOfParameter, anchor: "y2" },
    yaxis: { ...grid, domain: [0.42, 1], title: { text: `frequency (${unit})` }, range: [0, 1.08 * mostHz], zeroline: false },
    yaxis2: { ...grid, domain: [0, 0.36], title: { text: "Re λ (1/s)" },
      ...(floorOfGrowth > 0 ? { range: [-1.1 * floorOfGrowth, Math.max(1.15 * floorOfGrowth, 1.05 * topOfBars)] } : {}) } }, CONFIG);

  const relabel = () => Plotly.relayout(stability, { annotations: [...(narrow() ? [] : labelsOfOnsets()), ...labelOfRange()] });
  relabel();
  addEventListener("resize", () => setTimeout(relabel, 300));

  const locus = document.getElementById("locus"), shownGrowth = C.growthRange;
  const onAxis = C.branches.map((b) => ({ mode: "lines+markers", x: b.re, y: scaled(b.hz), text: texts(b), showlegend: false,
    line: { width: 1, color: colour.get(b.number) || "#9aa5af" }, marker: { size: b.grows ? 5 : 3 },
    hovertemplate: "%{text}<extra></extra>", customdata: b.value.map(() => b.number) }));
  // Lines from edge to edge are shapes: as traces they would be part of what the axes are scaled by.
  const heard = C.measured.map((m) => ({ type: "line", xref: "paper", x0: 0, x1: 1, y0: m.frequency_hz / per, y1: m.frequency_hz / per,
    line: { color: "#b3261e", width: 1.5, dash: "dot" },
    label: { text: plain(measuredName(m)), textposition: "start", yanchor: "bottom", font: { size: 11, color: "#b3261e" } } }));
  const half = { type: "rect", xref: "x", yref: "paper", x0: 0, x1: Math.max(shownGrowth[1], 1.15 * floorOfGrowth), y0: 0, y1: 1,
    fillcolor: "rgba(179,38,30,.06)", line: { width: 0 }, layer: "below" };
  const outside = C.growthNotes.map((note, i) => ({ xref: "paper", yref: "paper", x: 0, y: 1, xanchor: "left", yanchor: "bottom", yshift: 15 * (C.growthNotes.length - 1 - i),
    showarrow: false, text: plain(note), font: { size: 11, color: "#51606e" } }));
  Plotly.newPlot(locus, [...onAxis, { mode: "markers", x: [], y: [], marker: { size: 14, color: "rgba(240,165,0,.45)" }, hoverinfo: "skip", showlegend: false }],
    { ...base, shapes: [half, ...heard], annotations: outside, xaxis: { ...grid, title: { text: "growth rate Re λ (1/s)" }, range: shownGrowth },
      yaxis: { ...grid, title: { text: `frequency (${unit})` }, range: [0, 1.05 * mostHz], zeroline: false } }, CONFIG);

  const damping = document.getElementById("damping");
  const nearest = (b) => b.value.indexOf(C.values[at]);
  const ratios = C.branches.flatMap((b) => b.ratio).filter((r) => r !== null).map((r) => 100 * r);
  const worst = smallest(ratios, 0), best = largest(ratios.filter((r) => r < 20), Math.max(-worst, 0.01));
  function drawDamping() {
    const here = C.branches.map((b) => [b, nearest(b)]).filter(([, i]) => i >= 0);
    const unstable = here.map(([b, i]) => b.stability[i] === "unstable");
    const dots = { mode: "markers", x: here.map(([b, i]) => b.hz[i] / per), y: here.map(([b, i]) => b.ratio[i] === null ? null : 100 * b.ratio[i]),
      marker: { size: 9, color: unstable.map((u) => (u ? "#b3261e" : "#51606e")), symbol: unstable.map((u) => (u ? "diamond" : "circle")) },
      text: here.map(([b, i]) => hover(b, i)), hovertemplate: "%{text}<extra></extra>", customdata: here.map(([b]) => b.number), showlegend: false };
    const marked = here.filter(([b]) => b.number === chosen);
    const ring = { mode: "markers", x: marked.map(([b, i]) => b.hz[i] / per), y: marked.map(([b, i]) => 100 * b.ratio[i]),
      marker: { size: 20, color: "rgba(240,165,0,.45)" }, hoverinfo: "skip", showlegend: false };
    const measured = C.measured.map((m) => ({ mode: "lines", x: [m.frequency_hz / per, m.frequency_hz / per], y: [1.2 * worst, 1.2 * best],
      line: { color: "#b3261e", width: 1.5, dash: "dot" }, name: plain(measuredName(m)), hoverinfo: "name", showlegend: false }));
    Plotly.react(damping, [ring, dots, ...measured], { ...base, xaxis: { ...grid, title: { text: `frequency (${unit})` }, range: [0, 1.05 * mostHz] },
      yaxis: { ...grid, title: { text: "damping ratio (%)" }, range: [1.2 * worst - 0.02 * best, 1.2 * best], zerolinecolor: "#1d2329" },
      shapes: [{ type: "rect", xref: "paper", yref: "y", x0: 0, x1: 1, y0: 1.2 * worst - 0.02 * best, y1: 0, fillcolor: "rgba(179,38,30,.06)", line: { width: 0 }, layer: "below" }] }, CONFIG);
    const heads = ["branch", "frequency, Hz", "Re λ, 1/s", "damping ratio, %", "stability", "nodal diameters", "moves", "moves most"];
    const rows = here.map(([b, i]) => [String(b.number), digits(b.hz[i], 6), rate(b, i), digits(b.ratio[i] === null ? null : 100 * b.ratio[i], 3),
      b.stability[i], b.diameters[i] || "–", b.way[i] || "–", b.body[i] || "–"]);
    fillTable(document.querySelector("#at-value .scroll"), `All modes at ${C.symbol} = ${C.texts[at]}`, heads, rows, here.map(([b]) => b.number));
  }

  function describe() {
    const b = byNumber.get(chosen), place = document.getElementById("chosen");
    if (!b) { place.textContent = "No mode is chosen."; return; }
    const i = nearest(b);
    const words = i < 0 ? `is not among the modes at ${C.symbol} = ${C.texts[at]}` :
      `at ${C.symbol} = ${C.texts[at]}: ${digits(b.hz[i], 6)} Hz, Re λ = ${rate(b, i, " 1/s")}, damping ratio ${digits(b.ratio[i] === null ? null : 100 * b.ratio[i], 3)} %, ` +
      [b.stability[i], b.diameters[i], b.way[i], b.plane[i], b.body[i]].filter(Boolean).join(", ");
    const own = C.onsets.filter((o) => o.branches.includes(b.number));
    const onsets = own.filter((o) => !o.parting).map((o) => `${o.into ? "unstable from" : "stable again from"} ${o.text} on (${[o.law, o.mesh].filter(Boolean).join("; ")})`);
    const partings = own.filter((o) => o.parting).map((o) => ` At ${o.text}, ${[o.law, "growth neither begins nor ends there", o.mesh].filter(Boolean).join("; ")}.`);
    place.textContent = `Branch ${b.number} ${words}.` + (onsets.length ? ` It is ${onsets.join("; ")}.` : "") + partings.join("");
  }

  const select = document.getElementById("mode"), slider = document.getElementById("value");
  for (const b of [...growing, ...C.branches.filter((b) => !b.grows)]) {
    select.append(element("option", b.name + (b.grows ? " (unstable)" : ""), { value: b.number }));
  }
  select.addEventListener("change", () => choose(Number(select.value)));
  slider.max = C.values.length - 1;
  slider.value = at;
  document.getElementById("value-name").textContent = C.symbol;
  function move() {
    at = Number(slider.value);
    document.getElementById("value-text").textContent = C.texts[at];
    slider.setAttribute("aria-valuetext", `${C.symbol} = ${C.texts[at]}`);
    drawDamping();
    describe();
  }
  slider.addEventListener("input", move);
  slider.disabled = C.values.length < 2;

  listeners.push((branch) => {
    const b = byNumber.get(branch), count = stability.data.length;
    select.value = String(branch);
    Plotly.restyle(stability, { x: [b ? b.line[0].length ? b.line[0] : b.value : [], b ? b.growth[0] : []],
      y: [b ? b.line[1].length ? scaled(b.line[1]) : scaled(b.hz) : [], b ? b.growth[1] : []] }, [count - 2, count - 1]);
    Plotly.restyle(locus, { x: [b ? b.re : []], y: [b ? scaled(b.hz) : []] }, [locus.data.length - 1]);
    drawDamping();
    describe();
  });
  move();
  for (const chart of [stability, damping, locus]) {
    chart.on("plotly_click", (event) => {
      const hit = event.points.find((p) => p.customdata !== undefined && p.customdata !== null);
      if (hit) choose(hit.customdata);
    });
  }
  const all = document.getElementById("all-values");
  all.addEventListener("toggle", () => {
    if (!all.open || all.querySelector("table")) return;
    const rows = [], branches = [];
    for (const b of C.branches) b.value.forEach((v, i) => {
      rows.push([String(b.number), digits(v), digits(b.hz[i], 6), rate(b, i), digits(b.ratio[i] === null ? null : 100 * b.ratio[i], 3), b.stability[i]]);
      branches.push(b.number);
    });
    fillTable(all.querySelector(".scroll"), "All modes at all values", ["branch", C.symbol, "frequency, Hz", "Re λ, 1/s", "damping ratio, %", "stability"], rows, branches);
  });
  for (const row of document.querySelectorAll("#charts > .scroll tbody tr")) {
    const branch = Number(row.cells[0].textContent);
    if (!byNumber.has(branch) || !row.closest("table").caption.textContent.startsWith("Unstable")) continue;
    row.dataset.branch = branch;
    const button = element("button", row.cells[0].textContent, { type: "button", "aria-label": `Show branch ${branch}` });
    row.cells[0].replaceChildren(button);
    row.addEventListener("click", () => choose(branch));
  }
}
