if (DATA.shapes) {
  const S = DATA.shapes, place = document.getElementById("shape"), said = document.getElementById("shape-text");
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const points = new Float32Array(bytes(S.points)), triangles = new Uint32Array(bytes(S.triangles));
  const edges = new Uint32Array(bytes(S.edges)), count = points.length / 3;
  const column = (k) => Float32Array.from({ length: count }, (_, i) => points[3 * i + k]);
  const rest = [column(0), column(1), column(2)];
  const decoded = new Map();
  const play = document.getElementById("play"), phase = document.getElementById("phase");
  const select = document.getElementById("shape-mode"), amplitude = document.getElementById("amplitude");
  const colouring = document.getElementById("colour");
  let current = 0, playing = false, last = 0, busy = false, visible = true;

  // A body that moves has its own nodes in each trace; one numbering for all keeps this simple and costs little.
  const own = S.bodies.map((_, b) => {
    const part = triangles.subarray(3 * S.bounds[b], 3 * S.bounds[b + 1]);
    const used = [...new Set(part)], position = new Map(used.map((n, i) => [n, i]));
    return { used: Uint32Array.from(used), i: Uint32Array.from(part).map((n) => position.get(n)) };
  });

  function shapeOf(k) {
    if (!decoded.has(k)) {
      const raw = new Int16Array(bytes(S.shapes[k].u)), re = [], im = [], size = new Float32Array(count);
      for (let c = 0; c < 3; c++) {
        re.push(Float32Array.from({ length: count }, (_, n) => raw[6 * n + c] / 32767));
        im.push(Float32Array.from({ length: count }, (_, n) => raw[6 * n + 3 + c] / 32767));
      }
      for (let n = 0; n < count; n++) {  // the largest displacement over a period: √((|u|² + |u·u|)/2)
        let square = 0, a = 0, b = 0;
        for (let c = 0; c < 3; c++) {
          const x = re[c][n], y = im[c][n];
          square += x * x + y * y; a += x * x - y * y; b += 2 * x * y;
        }
        size[n] = Math.sqrt((square + Math.hypot(a, b)) / 2);
      }
      const axial = Math.max(...own.map((o) => o.used.reduce((m, n) => Math.max(m, Math.hypot(re[2][n], im[2][n])), 0)), 1e-3);
      decoded.set(k, { re, im, size, axial });
    }
    return decoded.get(k);
  }

  /** Places and colours of the bodies' nodes at a phase. */
  function frame() {
    const u = shapeOf(current), angle = Number(phase.value) * Math.PI / 180, c = Math.cos(angle), s = Math.sin(angle);
    const scale = 0.12 * S.size * Number(amplitude.value) / 100, axial = colouring.value === "axial";
    const update = { x: [], y: [], z: [], intensity: [] };
    for (const { used } of own) {
      const at = [0, 1, 2].map((k) => Float32Array.from(used, (n) => rest[k][n] + scale * (u.re[k][n] * c - u.im[k][n] * s)));
      update.x.push(at[0]); update.y.push(at[1]); update.z.push(at[2]);
      update.intensity.push(axial ? Float32Array.from(used, (n) => u.re[2][n] * c - u.im[2][n] * s) : Float32Array.from(used, (n) => u.size[n]));
    }
    return update;
  }

  const low = rest.map((x) => x.reduce((m, v) => Math.min(m, v), Infinity)), high = rest.map((x) => x.reduce((m, v) => Math.max(m, v), -Infinity));
  const room = 0.13 * S.size, ranges = low.map((l, k) => [l - room, high[k] + room]);
  const widths = ranges.map(([a, b]) => b - a), widest = Math.max(...widths);
  const zoom = 2.5;  // of the model in its box: it fills the picture of a disc seen obliquely
  const views = {
    oblique: { eye: { x: 0.9, y: -1.2, z: 1.0 }, up: { x: 0, y: 0, z: 1 } },
    side: { eye: { x: 0, y: -1.8, z: 0.12 }, up: { x: 0, y: 0, z: 1 } },
    axis: { eye: { x: 0, y: 0, z: 1.8 }, up: { x: 0, y: 1, z: 0 } },
  };
  const scene = (k) => ({ visible: false, showbackground: false, range: ranges[k], showspikes: false });
  const bodyTraces = () => {
    const u = frame();
    return S.bodies.map((name, b) => ({ type: "mesh3d", name: plain(name), x: u.x[b], y: u.y[b], z: u.z[b], i: own[b].i.filter((_, j) => j % 3 === 0),
      j: own[b].i.filter((_, j) => j % 3 === 1), k: own[b].i.filter((_, j) => j % 3 === 2), intensity: u.intensity[b], hoverinfo: "name",
      colorscale: "Viridis", cmin: 0, cmax: 1, showscale: b === 0, flatshading: false, lighting: { ambient: 0.65, diffuse: 0.6, specular: 0.1 },
      colorbar: { title: { text: "", side: "right" }, thickness: 12, len: 0.7 } }));
  };
  const lines = [[], [], []];
  for (let e = 0; e < edges.length; e += 2) for (let k = 0; k < 3; k++) lines[k].push(rest[k][edges[e]], rest[k][edges[e + 1]], null);
  const bodies = S.bodies.map((_, b) => b);

  function recolour() {
    const axial = colouring.value === "axial", most = shapeOf(current).axial;
    Plotly.restyle(place, { colorscale: [axial ? "RdBu" : "Viridis"], cmin: [axial ? -most : 0], cmax: [axial ? most : 1],
      "colorbar.title.text": [axial ? "along the axis / largest" : "amplitude / largest"] }, bodies);
  }
  async function draw() {
    if (busy) return;
    busy = true;
    try { await Plotly.restyle(place, frame(), bodies); } finally { busy = false; }
  }
  function tick(time) {
    if (!playing) return;
    if (visible && !busy && time - last > 40) {
      const passed = last ? Math.min(time - last, 200) : 40;
      last = time;
      phase.value = String((Number(phase.value) + Math.max(1, Math.round(passed * 0.18))) % 360);  // two seconds a period
      draw();
    }
    requestAnimationFrame(tick);
  }
  function setPlaying(on) {
    playing = on;
    last = 0;
    play.textContent = on ? "Pause" : "Play";
    play.setAttribute("aria-pressed", String(on));
    if (on) requestAnimationFrame(tick);
  }
  function tell() {
    const s = S.shapes[current];
    const name = s.branch !== undefined ? `Branch ${s.branch}` : `Mode ${s.mode}`;
    const where = DATA.charts && s.value !== undefined ? ` at ${DATA.charts.symbol} = ${digits(s.value)}` : "";
    said.textContent = `${name}${where}: ${digits(s.frequency_hz, 6)} Hz, Re λ = ${digits(s.re)} 1/s. Displacements are drawn many times larger than they are; how large they are, a linear analysis does not say.`;
  }

  /** Why a branch has no shape on the page. */
  function whyNot(branch) {
    const own = DATA.charts ? DATA.charts.branches.find((b) => b.number === branch) : undefined;
    if (S.left_out.includes(branch)) return `The shape of branch ${branch} is not on this page, which has room for ${S.shapes.length}; it is in the folder shapes/.`;
    if (own && own.grows) return `Branch ${branch} is unstable, but its shape could not be shown: it grows between two values of the sweep only, or its file in shapes/ is missing or cannot be read.`;
    return `Of branch ${branch} there is no shape here: it is not unstable. With [output] shapes = "all" the shapes at the last value are written as well.`;
  }

  function probe() {
    const canvas = document.createElement("canvas");
    return Boolean(canvas.getContext("webgl2") || canvas.getContext("webgl"));
  }
  if (!probe()) {
    said.textContent = "This browser cannot draw in three dimensions (it has no WebGL), so shapes are not shown here; the folder shapes/ has pictures of them.";
    place.remove();
  } else {
    Plotly.newPlot(place, [...bodyTraces(), { type: "scatter3d", mode: "lines", x: lines[0], y: lines[1], z: lines[2],
      line: { color: "#51606e", width: 2 }, hoverinfo: "skip", showlegend: false }],
      { margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "#f4f6f8", showlegend: false, uirevision: "kept",
        scene: { xaxis: scene(0), yaxis: scene(1), zaxis: scene(2), aspectmode: "manual", uirevision: "kept",
          aspectratio: { x: zoom * widths[0] / widest, y: zoom * widths[1] / widest, z: zoom * widths[2] / widest },
          camera: { ...views.oblique, projection: { type: "orthographic" } } } }, CONFIG);
    S.shapes.forEach((s, k) => {
      const name = s.branch !== undefined ? `branch ${s.branch}` : `mode ${s.mode}`;
      select.append(element("option", `${name}, ${digits(s.frequency_hz, 5)} Hz`, { value: k }));
    });
    S.bodies.forEach((name, b) => {
      const label = element("label", null), box = element("input", null, { type: "checkbox" });
      box.checked = true;
      box.addEventListener("change", () => Plotly.restyle(place, { visible: box.checked }, [b]));
      label.append(box, document.createTextNode(" " + name));
      document.getElementById("bodies").append(label);
    });
    const showShape = (k) => { current = k; select.value = String(k); tell(); recolour(); draw(); };
    select.addEventListener("change", () => {
      showShape(Number(select.value));
      const branch = S.shapes[current].branch;
      if (branch !== undefined && branch !== chosen) choose(branch);
    });
    play.addEventListener("click", () => setPlaying(!playing));
    amplitude.addEventListener("input", draw);
    phase.addEventListener("input", () => { setPlaying(false); draw(); });
    colouring.addEventListener("change", () => { recolour(); draw(); });
    document.getElementById("edges").addEventListener("change", (event) => Plotly.restyle(place, { visible: event.target.checked }, [S.bodies.length]));
    for (const button of document.querySelectorAll("#views button")) {
      button.addEventListener("click", () => {
        for (const other of document.querySelectorAll("#views button")) other.setAttribute("aria-pressed", String(other === button));
        Plotly.relayout(place, { "scene.camera": { ...views[button.dataset.view], projection: { type: "orthographic" } } });
      });
    }
    listeners.push((branch) => {
      const k = S.shapes[current].branch === branch ? current : S.shapes.findIndex((s) => s.branch === branch);
      if (k >= 0) showShape(k);
      else said.textContent = `${whyNot(branch)} The shape below is another one, that of branch ${S.shapes[current].branch}.`;
    });
    new IntersectionObserver((entries) => { visible = entries[0].isIntersecting; }).observe(place);
    showShape(0);
    if (!matchMedia("(prefers-reduced-motion: reduce)").matches) setPlaying(true);
    addEventListener("beforeprint", () => setPlaying(false));
  }
}
if (DATA.charts && DATA.charts.branches.length) {
  const first = DATA.shapes && DATA.shapes.shapes[0] ? DATA.shapes.shapes[0].branch : undefined;
  const grows = DATA.charts.branches.find((b) => b.grows);
  choose(first !== undefined ? first : grows ? grows.number : DATA.charts.branches[0].number);
}
