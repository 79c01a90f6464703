// The balls of a report: each is a file of its own, which is loaded when it is asked for; that works from file:// too.
"use strict";
const reportState = {folder: "", count: 0, shown: 0, timer: 0};

function startReport(folder, count, first) {
  Object.assign(reportState, {folder, count});
  addEventListener("hashchange", showFromAddress);
  document.getElementById("earlier").onclick = () => goToBall(reportState.shown - 1);
  document.getElementById("later").onclick = () => goToBall(reportState.shown + 1);
  showFromAddress(first);
}

function goToBall(number) {
  if (number >= 1 && number <= reportState.count) location.hash = `ball-${number}`;
}

function showFromAddress(fallback) {
  const found = /^#ball-(\d+)$/.exec(location.hash);
  const number = found ? Number(found[1]) : Number.isInteger(fallback) ? fallback : 0;
  if (number < 1 || number > reportState.count || number === reportState.shown) return;
  reportState.shown = number;
  clearInterval(reportState.timer);
  document.getElementById("ball").textContent = "loading ...";
  document.getElementById("earlier").disabled = number === 1;
  document.getElementById("later").disabled = number === reportState.count;
  const script = document.createElement("script");
  script.src = `${reportState.folder}/ball_${String(number).padStart(4, "0")}.js`;
  script.onerror = () => {
    document.getElementById("ball").textContent = `${decodeURI(script.src)} is missing: the folder ${reportState.folder} belongs beside this page.`;
  };
  document.head.append(script);
  if (found) document.getElementById("balls").scrollIntoView();
}

function element(kind, attributes, ...children) {
  const made = document.createElement(kind);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

// Called by the file of a ball.
function reportBall(number, ball) {
  if (number !== reportState.shown) return;
  const root = document.getElementById("ball");
  root.replaceChildren(element("h3", {}, ball.title));
  if (ball.reason) root.append(element("p", {class: "bad"}, `Not returned: ${ball.reason}.`));
  const rows = ball.facts.map(([name, value]) => element("tr", {}, element("td", {}, name), element("td", {}, value)));
  root.append(element("div", {class: "wide"}, element("table", {}, element("tbody", {}, ...rows))));
  root.append(scenePart(ball.scene));
  if (ball.images.length) root.append(imagesPart(ball));
  const figures = element("div", {class: "figures"});
  root.append(figures);
  for (const {title, height, figure} of ball.figures) {
    const drawn = element("div", {class: "drawn", style: `height: ${height}px`});
    figures.append(element("figure", {}, element("figcaption", {}, title), drawn));
    if (typeof Plotly !== "undefined") drawFigure(drawn, figure);
  }
  drawScene(ball.scene);
}

const SVG = "http://www.w3.org/2000/svg";

function imagesPart(ball) {
  const part = element("figure", {}, element("figcaption", {}, "The images it was measured from"), element("p", {}, ball.words));
  part.append(element("p", {class: "quiet"},
    "Blue: outline of the measured ball. Orange dots: edge found in the image. Yellow: equator of the measured spin, and a meridian that " +
    "turns with it; marks keep their place beside the meridian when the spin is right. Below each image: time since the last one, and " +
    "median distance of the edges from the outline."));
  const names = [...new Set(ball.images.map((image) => image.camera))];
  for (const name of names) {
    const strip = element("div", {class: "strip"});
    for (const image of ball.images.filter((one) => one.camera === name)) {
      const svg = document.createElementNS(SVG, "svg");
      svg.setAttribute("viewBox", "0 0 150 150");
      const picture = document.createElementNS(SVG, "image");
      picture.setAttribute("href", `data:image/jpeg;base64,${image.jpeg}`);
      picture.setAttribute("width", "150");
      picture.setAttribute("height", "150");
      svg.append(picture);
      for (const [kind, line] of [["outline", image.outline], ["equator", image.equator], ["edges", image.edges]]) {
        const path = document.createElementNS(SVG, "path");
        path.setAttribute("class", kind);
        path.setAttribute("d", line);
        svg.append(path);
      }
      const off = image.off === null ? "" : `, ${image.off.toFixed(2)} px`;
      strip.append(element("div", {}, svg, element("div", {class: "quiet"}, `${image.ms.toFixed(1)} ms${off}`)));
    }
    part.append(element("div", {class: "quiet"}, `${name} camera`), strip);
  }
  return part;
}

function scenePart(scene) {
  const play = element("button", {id: "play", type: "button"}, "Play");
  const slider = element("input", {id: "step", type: "range", min: "0", max: String(Math.max(0, scene.ball.length - 1)), value: "0",
    "aria-label": "time"});
  const label = element("span", {id: "time", class: "quiet"}, "");
  const speed = element("select", {id: "speed", "aria-label": "speed"});
  for (const [value, name] of [["1", "real time"], ["0.5", "half speed"], ["0.2", "a fifth"]]) {
    speed.append(element("option", {value}, name));
  }
  speed.value = "0.5";
  return element("figure", {}, element("figcaption", {}, "The rally"), element("div", {id: "rally"}),
    element("div", {class: "player"}, play, slider, label, speed));
}

function columns(points) {
  return {x: points.map((p) => p[0]), y: points.map((p) => p[1]), z: points.map((p) => p[2])};
}

function drawScene(scene) {
  if (typeof Plotly === "undefined") return;
  const root = document.getElementById("rally");
  const [length, width, netX, netHeight, overhang] = scene.table;
  const quad = (points, color, opacity, name) => ({type: "mesh3d", ...columns(points), i: [0, 0], j: [1, 2], k: [2, 3], color, opacity, name,
    hoverinfo: "name", flatshading: true});
  const line = (points, color, name, dash, size) => ({type: "scatter3d", mode: "lines", ...columns(points), name,
    line: {color, width: size || 4, dash: dash || "solid"}, hoverinfo: "name"});
  const spots = (points, color, name, symbol, size) => ({type: "scatter3d", mode: "markers", ...columns(points), name,
    marker: {color, size, symbol}, hoverinfo: "name"});
  const fixed = [
    quad([[0, 0, 0], [length, 0, 0], [length, width, 0], [0, width, 0]], "#2f6f9f", 0.9, "table"),
    quad([[netX, -overhang, 0], [netX, width + overhang, 0], [netX, width + overhang, netHeight], [netX, -overhang, netHeight]],
      "#b8bec6", 0.45, "net"),
    line(scene.true, "#56b4e9", "true ball"),
    line(scene.predicted, "#d55e00", "predicted", "dot"),
    spots(scene.asked ? [scene.asked] : [], "#009e73", "landing asked", "circle-open", 9),
    spots(scene.landed ? [scene.landed] : [], "#e69f00", "landing reached", "x", 5),
  ];
  const moving = [
    {...spots([], "#ffa630", "ball", "circle", 6), showlegend: false},
    {type: "scatter3d", mode: "lines+markers", x: [], y: [], z: [], name: "arm", line: {color: "#8b95a1", width: 12},
      marker: {color: "#5f6b78", size: 5}, hoverinfo: "name", showlegend: false},
    {type: "mesh3d", x: [0], y: [0], z: [0], color: "#c23b22", opacity: 1, name: "racket", hoverinfo: "name", flatshading: true},
  ];
  const fan = scene.racket.length ? scene.racket[0].map((_, k) => k).slice(1, -1) : [];
  Object.assign(moving[2], {i: fan.map(() => 0), j: fan, k: fan.map((k) => k + 1)});
  const across = (low, high) => ({visible: false, range: [low, high]});  // m, the same for every ball
  const layout = {
    template: pageTemplate(), margin: {l: 0, r: 0, t: 0, b: 0}, showlegend: true, uirevision: 1,
    legend: {orientation: "h", x: 0, y: 0, yanchor: "bottom"},
    scene: {xaxis: across(-1.3, 3.0), yaxis: across(-0.4, 1.9), zaxis: across(-0.4, 1.1), aspectmode: "data",
      camera: {eye: {x: 0.45, y: -1.15, z: 0.6}, center: {x: 0, y: 0, z: -0.1}}},
  };
  Plotly.newPlot(root, [...fixed, ...moving], layout, {responsive: true, displaylogo: false, displayModeBar: false});
  const places = moving.map((_, k) => fixed.length + k);
  const slider = document.getElementById("step");
  const show = () => {
    const k = Number(slider.value);
    const now = [scene.ball[k] ? [scene.ball[k]] : [], scene.arm[k] || [], scene.racket[k] || []].map(columns);
    Plotly.restyle(root, {x: now.map((c) => c.x), y: now.map((c) => c.y), z: now.map((c) => c.z)}, places);
    document.getElementById("time").textContent = `${(k * scene.step).toFixed(2)} s after the launch`;
  };
  slider.oninput = show;
  const play = document.getElementById("play");
  const stop = () => { clearInterval(reportState.timer); reportState.timer = 0; play.textContent = "Play"; };
  play.onclick = () => {
    if (reportState.timer) return stop();
    if (Number(slider.value) >= Number(slider.max)) slider.value = "0";
    const from = Number(slider.value), speed = Number(document.getElementById("speed").value), begun = performance.now();
    play.textContent = "Pause";
    reportState.timer = setInterval(() => {
      slider.value = String(Math.min(Number(slider.max), from + Math.floor((performance.now() - begun) * 1e-3 * speed / scene.step)));
      show();
      if (Number(slider.value) >= Number(slider.max)) stop();
    }, 40);
  };
  slider.value = String(scene.strike);
  show();
}
