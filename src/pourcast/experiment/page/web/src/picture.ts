/** An answer as a picture: how full the parts of the goal are. */
import type { AnswerPicture } from "./types";

const SVG = "http://www.w3.org/2000/svg";
const WIDTH = 160;
const HEIGHT = 56;

function shape(kind: string, attributes: { [name: string]: string | number }): SVGElement {
  const element = document.createElementNS(SVG, kind);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  return element;
}

/** The picture of an answer; without one (null) it shows no liquid. */
export function drawAnswer(picture: AnswerPicture, colour: string, share: number | null): SVGElement {
  const svg = shape("svg", {
    viewBox: `0 0 ${WIDTH} ${HEIGHT}`,
    width: WIDTH,
    height: HEIGHT,
    "aria-hidden": "true",
    class: "split",
  });
  if (share !== null) {
    for (const column of picture.columns) {
      const height = (column.judged ? share : 1 - share) * column.full * HEIGHT;
      const [x, width, y] = [column.x * WIDTH, column.width * WIDTH, HEIGHT - height];
      svg.append(shape("rect", { x, y, width, height, fill: colour, class: "liquid" }));
    }
  }
  for (const part of picture.parts) {
    const points = part.map(([x, y]) => `${x * WIDTH},${(1 - y) * HEIGHT}`).join(" ");
    svg.append(shape("polygon", { points, class: "goal" }));
  }
  svg.append(shape("rect", { x: 0.5, y: 0.5, width: WIDTH - 1, height: HEIGHT - 1, class: "box" }));
  return svg;
}
