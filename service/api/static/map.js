// The map along the rack: how wide the gap is at each diagnostic position, in the band it is to stay in.

import { BOX, HEIGHT, WIDTH, drawBand, drawHeights, drawValue, scale } from "./chart.js";
import { interval, svg, um } from "./dom.js";

const FEET = 5;

export function alongRack(axis) {
  const shown = [...axis.by_place].sort((a, b) => a.position_m - b.position_m);
  const root = svg("svg", { class: "curve", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": inWords(axis, shown) });
  const [first, last] = [shown[0].position_m, shown.at(-1).position_m];
  const room = WIDTH - BOX.left - BOX.right - 40;
  const by = scale(axis, shown, (index) => BOX.left + 20 + (room * (shown[index].position_m - first)) / (last - first));
  drawBand(root, axis, by);
  shown.forEach((place, index) => drawValue(root, place, index, by, `at ${metres(place)}`));
  drawHeights(root, by);
  const every = Math.ceil(shown.length / FEET);
  shown.forEach((place, index) => {
    if (index % every === 0) {
      root.append(svg("text", { x: by.x(index), y: HEIGHT - 5, "text-anchor": "middle" }, metres(place)));
    }
  });
  return root;
}

const metres = (place) => `${place.position_m.toFixed(2)} m`;

function inWords(axis, shown) {
  const each = shown.map((place) => `at ${metres(place)} ${place.backlash_m === null ? "no value"
    : `${um(place.backlash_m)} ${interval(place.backlash_m, place.interval_95_m)} µm`}`);
  return `${axis.name} along the rack: ${each.join(", ")}`;
}
