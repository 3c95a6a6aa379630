// People's means against any model's judgments; the scene of the dot that is pointed at.
"use strict";
(() => {
  const SVG = "http://www.w3.org/2000/svg";
  const data = JSON.parse(document.getElementById("explore-data").textContent);
  const root = document.getElementById("explore");

  function element(parent, name, attributes, text) {
    const made = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    if (text !== undefined) made.textContent = text;
    parent.appendChild(made);
    return made;
  }

  function choice(label, options) {
    const wrap = document.createElement("label");
    wrap.textContent = `${label} `;
    const select = document.createElement("select");
    for (const [value, text] of options) select.add(new Option(text, value));
    wrap.appendChild(select);
    return [wrap, select];
  }

  const left = document.createElement("div");
  const controls = document.createElement("p");
  const [liquidLabel, liquidSelect] = choice("Trials", data.liquids.map((one, k) => [k, one.liquid]));
  const [modelLabel, modelSelect] = choice("Model", Object.keys(data.liquids[0].models).map((m) => [m, m]));
  modelLabel.style.marginLeft = "1rem";
  controls.append(liquidLabel, modelLabel);
  const plot = document.createElementNS(SVG, "svg");
  plot.setAttribute("class", "plot");
  plot.setAttribute("viewBox", "0 0 400 400");
  left.append(controls, plot);
  const side = document.createElement("div");
  side.id = "thumbnail";
  side.setAttribute("aria-live", "polite");
  root.append(left, side);

  const X = (value) => 50 + 340 * value;
  const Y = (value) => 350 - 340 * value;

  function thumbnail(id, words) {
    const scene = data.scenes[id];
    side.replaceChildren();
    const picture = element(side, "svg", { viewBox: `0 0 ${scene.width} ${scene.height}`, width: "100%" });
    element(picture, "rect", { width: scene.width, height: scene.height, fill: "#f7f7f4", stroke: "#5b6470", "stroke-width": 0.01 });
    const flip = (polygon) => polygon.map(([x, y]) => `${x},${scene.height - y}`).join(" ");
    for (const polygon of scene.obstacles) element(picture, "polygon", { points: flip(polygon), fill: "#5b6470" });
    for (const polygon of scene.goal) element(picture, "polygon", { points: flip(polygon), fill: "#a3684f" });
    const [x, y, radius] = scene.liquid;
    element(picture, "circle", { cx: x, cy: scene.height - y, r: radius, fill: data.liquids[liquidSelect.value].colour });
    const line = document.createElement("p");
    line.textContent = words;
    side.appendChild(line);
  }

  function draw() {
    const one = data.liquids[liquidSelect.value];
    const model = modelSelect.value;
    plot.replaceChildren();
    element(plot, "rect", { x: X(0), y: Y(1), width: 340, height: 340, fill: "none", stroke: "#888" });
    element(plot, "line", { x1: X(0), y1: Y(0), x2: X(1), y2: Y(1), stroke: "#bbb", "stroke-dasharray": "3 3" });
    for (const tick of [0, 0.5, 1]) {
      element(plot, "text", { x: X(tick), y: 366, "text-anchor": "middle", "font-size": 12 }, tick);
      element(plot, "text", { x: 44, y: Y(tick) + 4, "text-anchor": "end", "font-size": 12 }, tick);
    }
    element(plot, "text", { x: X(0.5), y: 388, "text-anchor": "middle", "font-size": 13 }, model);
    element(plot, "text", { transform: `translate(16 ${Y(0.5)}) rotate(-90)`, "text-anchor": "middle", "font-size": 13 }, data.people);
    one.scenes.forEach((id, k) => {
      const [x, y] = [one.models[model][k], one.people[k]];
      const words = `${id}: ${data.people} ${y.toFixed(2)}, ${model} ${x.toFixed(2)}`;
      const dot = element(plot, "circle", {
        cx: X(x), cy: Y(y), r: 5, fill: one.colour, "fill-opacity": 0.7,
        tabindex: 0, role: "img", "aria-label": words,
      });
      for (const event of ["mouseenter", "focus"]) dot.addEventListener(event, () => thumbnail(id, words));
    });
    thumbnail(one.scenes[0], `${one.scenes[0]}: ${data.people} ${one.people[0].toFixed(2)}, ${model} ${one.models[model][0].toFixed(2)}`);
  }

  liquidSelect.addEventListener("change", draw);
  modelSelect.addEventListener("change", draw);
  draw();
})();

// What is folded up on the screen is shown on paper.
addEventListener("beforeprint", () => {
  for (const one of document.querySelectorAll("details:not([open])")) {
    one.open = true;
    one.dataset.folded = "";
  }
});
addEventListener("afterprint", () => {
  for (const one of document.querySelectorAll("details[data-folded]")) {
    one.open = false;
    delete one.dataset.folded;
  }
});
