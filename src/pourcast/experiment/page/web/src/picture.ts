/** An answer as a picture: how full each basin is, or the cup and the floor beside it. */
import type { Goal } from "./types";

const SVG = "http://www.w3.org/2000/svg";
const WIDTH = 160;
const HEIGHT = 56;

function shape(kind: string, attributes: { [name: string]: string | number }): SVGElement {
  const element = document.createElementNS(SVG, kind);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  return element;
}

/** A rectangle that stands on the floor. */
function column(x: number, width: number, height: number, css: string): SVGElement {
  return shape("rect", { x, y: HEIGHT - height, width, height, class: css });
}

export function drawSplit(goal: Goal, liquid: string, share: number | null): SVGElement {
  const svg = shape("svg", {
    viewBox: `0 0 ${WIDTH} ${HEIGHT}`,
    width: WIDTH,
    height: HEIGHT,
    "aria-hidden": "true",
    class: "split",
  });
  const css = `liquid-${liquid}`;
  if (goal === "basins") {
    const half = WIDTH / 2;
    if (share !== null) {
      svg.append(column(0, half, (1 - share) * HEIGHT, css));
      svg.append(column(half, half, share * HEIGHT, css));
    }
    const wedge = `${half - 6},${HEIGHT} ${half},8 ${half + 6},${HEIGHT}`;
    svg.append(shape("polygon", { points: wedge, class: "goal" }));
  } else {
    const third = WIDTH / 3;
    if (share !== null) {
      svg.append(column(third, third, share * HEIGHT, css));
      // What misses the cup lies on twice its width.
      svg.append(column(0, third, ((1 - share) * HEIGHT) / 2, css));
      svg.append(column(2 * third, third, ((1 - share) * HEIGHT) / 2, css));
    }
    svg.append(column(third - 4, 4, HEIGHT, "goal"));
    svg.append(column(2 * third, 4, HEIGHT, "goal"));
  }
  svg.append(shape("rect", { x: 0.5, y: 0.5, width: WIDTH - 1, height: HEIGHT - 1, class: "box" }));
  return svg;
}
