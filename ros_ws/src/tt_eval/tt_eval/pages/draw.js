// Draws the figures of a page with Plotly, in the colours of the page, which follow the system.
"use strict";
const darkness = matchMedia("(prefers-color-scheme: dark)");

function pageColour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

function pageTemplate() {
  const axis = {gridcolor: pageColour("--line"), zerolinecolor: pageColour("--line"), linecolor: pageColour("--quiet"), automargin: true};
  const room = {...axis, backgroundcolor: "rgba(0,0,0,0)", showbackground: false};
  return {layout: {
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: {color: pageColour("--text"), size: 13}, margin: {l: 50, r: 15, t: 20, b: 45},
    legend: {orientation: "h", x: 0, y: 1.02, yanchor: "bottom", itemsizing: "constant"},
    hoverlabel: {bgcolor: pageColour("--card"), font: {color: pageColour("--text")}},
    xaxis: axis, yaxis: axis, scene: {xaxis: room, yaxis: room, zaxis: room},
  }};
}

function drawFigure(element, figure) {
  const layout = {...figure.layout, template: pageTemplate()};
  return Plotly.newPlot(element, figure.data, layout, {responsive: true, displaylogo: false, modeBarButtonsToRemove: ["lasso2d", "select2d"]});
}

function drawFigures(root) {
  if (typeof Plotly === "undefined") return;
  for (const element of root.querySelectorAll(".drawn")) {
    if (!element.data) drawFigure(element, JSON.parse(element.nextElementSibling.textContent));
  }
}

darkness.addEventListener("change", () => {
  for (const element of document.querySelectorAll(".drawn")) if (element.data) Plotly.relayout(element, {template: pageTemplate()});
});
drawFigures(document);
