"use strict";
const DATA = JSON.parse(document.getElementById("data").textContent);
const CONFIG = { responsive: true, displaylogo: false, modeBarButtonsToRemove: ["sendDataToCloud", "select2d", "lasso2d"] };
// Okabe and Ito's colours, told apart without red and green; pale yellow left out
const COLOURS = ["#d55e00", "#0072b2", "#009e73", "#cc79a7", "#7a5195", "#e69f00", "#1b9e9e", "#8c2d04", "#4d4d4d"];
const listeners = [];
let chosen = null;

/** Mark a branch everywhere. */
function choose(branch) {
  chosen = branch;
  for (const tell of listeners) tell(branch);
  for (const row of document.querySelectorAll("[data-branch]")) {
    row.classList.toggle("chosen", Number(row.dataset.branch) === branch);
  }
  const section = document.getElementById("branch-" + branch);
  if (section) section.open = true;
}

function element(tag, text, attributes = {}) {
  const made = document.createElement(tag);
  if (text !== null) made.textContent = text;
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
}

function fillTable(place, caption, heads, rows, branches) {
  const table = element("table", null), head = element("tr", null);
  table.append(element("caption", caption), element("thead", null), element("tbody", null));
  heads.forEach((h, i) => head.append(element("th", h, { scope: "col", class: i ? "number" : "" })));
  table.tHead.append(head);
  rows.forEach((cells, k) => {
    const row = element("tr", null, { "data-branch": branches[k] });
    cells.forEach((c, i) => row.append(element(i ? "td" : "th", c, i ? { class: "number" } : { scope: "row" })));
    row.classList.toggle("chosen", branches[k] === chosen);
    row.addEventListener("click", () => choose(branches[k]));
    table.tBodies[0].append(row);
  });
  place.replaceChildren(table);
}

/** The largest and the smallest of any count of numbers; Math.max takes about 1e5 arguments at most. */
const largest = (numbers, least = -Infinity) => numbers.reduce((m, x) => Math.max(m, x), least);
const smallest = (numbers, most = Infinity) => numbers.reduce((m, x) => Math.min(m, x), most);

/** n digits, in plain or in scientific form. */
function digits(x, n = 5) {
  if (x === null || x === undefined) return "–";
  const size = Math.abs(x);
  return x === 0 ? "0" : size < 1e-4 || size >= 1e7 ? Number(x.toPrecision(n)).toExponential() : String(Number(x.toPrecision(n)));
}

/** Text for Plotly, which takes some HTML for its own. */
function plain(text) {
  return String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/\$/g, "&#36;");
}

for (const plot of DATA.plots || []) Plotly.newPlot(plot.id, plot.data, plot.layout, CONFIG);

const closed = [];
addEventListener("beforeprint", () => {
  for (const d of document.querySelectorAll("details.mode:not([open])")) { d.open = true; closed.push(d); }
  for (const chart of document.querySelectorAll(".chart.js-plotly-plot")) {
    chart.dataset.width = chart.style.width;
    chart.style.width = "180mm";
    Plotly.Plots.resize(chart);
  }
});
addEventListener("afterprint", () => {
  for (const d of closed.splice(0)) d.open = false;
  for (const chart of document.querySelectorAll(".chart.js-plotly-plot")) {
    chart.style.width = chart.dataset.width || "";
    Plotly.Plots.resize(chart);
  }
});
