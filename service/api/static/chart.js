// The curve of an axis: values with their intervals, the trend, the band it is to stay in, and the refusals.

import { day, svg, um } from "./dom.js";

export const WIDTH = 380;
export const HEIGHT = 150;
export const BOX = { left: 38, right: 8, top: 10, bottom: 20 };

export function curve(axis, values) {
  const shown = [...values].reverse();
  const root = svg("svg", { class: "curve", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": inWords(axis, shown) });
  if (shown.length === 0) {
    root.append(svg("text", { x: WIDTH / 2, y: HEIGHT / 2, "text-anchor": "middle" }, "no values yet"));
    return root;
  }
  const by = scales(axis, shown);
  drawBand(root, axis, by);
  shown.forEach((value, index) => drawValue(root, value, index, by, `run ${value.run_id}`));
  drawTrend(root, shown, by);
  drawHeights(root, by);
  drawDays(root, shown);
  return root;
}

// Values stand at even distances, in their order: nights are even, and a row of checks on one day stays readable.
function scales(axis, shown) {
  const step = (WIDTH - BOX.left - BOX.right) / Math.max(1, shown.length);
  return scale(axis, shown, (index) => BOX.left + step * (index + 0.5));
}

// Heights for values with their intervals, trend levels and the band of the axis; `x` tells where across.
export function scale(axis, shown, x) {
  const numbers = shown.flatMap((v) => [v.backlash_m, ...(v.interval_95_m ?? []), v.trend?.level_m]);
  if (axis.reference_m !== null && axis.tolerance_m !== null) {
    numbers.push(axis.reference_m - axis.tolerance_m, axis.reference_m + axis.tolerance_m);
  }
  const known = numbers.filter((n) => typeof n === "number");
  const low = known.length ? Math.min(...known) : 0;
  const high = known.length ? Math.max(...known) : 1e-6;
  const margin = Math.max(0.08 * (high - low), 0.5e-6);
  const [bottom, top] = [Math.max(0, low - margin), high + margin];
  return { bottom, top, x, y: (metres) => HEIGHT - BOX.bottom - ((metres - bottom) / (top - bottom)) * (HEIGHT - BOX.top - BOX.bottom) };
}

export function drawBand(root, axis, { y }) {
  if (axis.reference_m === null) return;
  const line = (metres, name) =>
    svg("line", { class: name, x1: BOX.left, x2: WIDTH - BOX.right, y1: y(metres), y2: y(metres) });
  if (axis.tolerance_m !== null) {
    const [low, high] = [Math.max(0, axis.reference_m - axis.tolerance_m), axis.reference_m + axis.tolerance_m];
    root.append(
      svg("rect", { class: "band", x: BOX.left, width: WIDTH - BOX.left - BOX.right, y: y(high), height: y(low) - y(high) }),
      line(low, "edge"), line(high, "edge"),
    );
  }
  root.append(line(axis.reference_m, "reference"));
}

// A value with its interval, or a cross at the foot where it was refused; `of` says whose it is.
export function drawValue(root, value, index, { x, y }, of) {
  const at = x(index);
  if (value.backlash_m === null) {
    const foot = HEIGHT - BOX.bottom - 6;
    root.append(svg("path", { class: "refused", d: `M${at - 4} ${foot - 4}l8 8m0 -8l-8 8` },
      svg("title", {}, `${of} refused: ${value.reason_in_words}`)));
    return;
  }
  if (value.interval_95_m) {
    const [low, high] = value.interval_95_m;
    root.append(svg("line", { class: "bar", x1: at, x2: at, y1: y(low), y2: y(high) }));
  }
  root.append(svg("circle", { class: "point", cx: at, cy: y(value.backlash_m), r: 2.6 },
    svg("title", {}, `${of}: ${um(value.backlash_m)} µm`)));
}

function drawTrend(root, shown, { x, y }) {
  const points = shown.flatMap((v, i) => (v.trend ? [`${x(i).toFixed(1)},${y(v.trend.level_m).toFixed(1)}`] : []));
  if (points.length > 1) root.append(svg("polyline", { class: "trend", points: points.join(" ") }));
}

export function drawHeights(root, { bottom, top, y }) {
  const marks = ticks(bottom, top);
  const digits = marks.length > 1 && marks[1] - marks[0] < 0.99e-6 ? 1 : 0;
  for (const metres of marks) {
    root.append(svg("text", { x: BOX.left - 6, y: y(metres) + 4, "text-anchor": "end" }, um(metres, digits)));
  }
  root.append(svg("text", { x: 2, y: BOX.top }, "µm"));
}

function drawDays(root, shown) {
  const ends = [shown[0], shown.at(-1)].map((v) => day(Date.parse(v.measured_at)));
  root.append(svg("text", { x: BOX.left, y: HEIGHT - 5 }, ends[0]));
  if (shown.length > 1) root.append(svg("text", { x: WIDTH - BOX.right, y: HEIGHT - 5, "text-anchor": "end" }, ends[1]));
}

// Two to five round values [m] between two ends, clear of the unit in the corner.
function ticks(bottom, top) {
  const span = top - bottom;
  const unit = 10 ** Math.floor(Math.log10(span));
  const step = [0.2, 0.5, 1, 2, 5].map((n) => n * unit).find((n) => span / n <= 4) ?? unit;
  const found = [];
  for (let metres = Math.ceil(bottom / step) * step; metres <= top - 0.12 * span; metres += step) found.push(metres);
  return found;
}

function inWords(axis, shown) {
  const accepted = shown.filter((v) => v.backlash_m !== null);
  if (accepted.length === 0) return `${axis.name}: no values yet`;
  const last = accepted.at(-1);
  const band = axis.reference_m === null || axis.tolerance_m === null ? ""
    : `, to stay within ${um(axis.reference_m)} ± ${um(axis.tolerance_m)} µm`;
  return `${axis.name}: ${accepted.length} values, the first ${um(accepted[0].backlash_m)}, `
    + `the latest ${um(last.backlash_m)} µm${band}; ${shown.length - accepted.length} runs refused`;
}
