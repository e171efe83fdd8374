// What the runs found beside the backlash: stiffness, friction, skew, where they stand and where they go.

import { el, rounded, svg } from "./dom.js";

const WIDTH = 90;
const HEIGHT = 22;
const MARGIN = 3;

const open = new Set();
const isMoving = (product) => /^(growing|falling)/.test(product.shown.trend_in_words);

// Closed at first, and open again when the card is drawn anew; the line says what is not steady.
export function byProducts(axis, products) {
  if (products.length === 0) return null;
  const moving = products.filter(isMoving);
  const news = moving.length ? moving.map((p) => `${p.label.toLowerCase()} ${p.shown.trend_in_words}`).join(", ") : products[0].shown.trend_in_words;
  const box = el("details", { class: "products", open: open.has(axis.name) },
    el("summary", {}, `Stiffness and friction: ${news}`), el("ul", {}, ...products.map(row)));
  box.addEventListener("toggle", () => (box.open ? open.add(axis.name) : open.delete(axis.name)));
  return box;
}

// The trend where there is one, and what a change means.
function row(product) {
  const { shown } = product;
  const trend = product.slope_per_day === null ? "" : shown.trend_in_words + (isMoving(product) && product.says ? ` (${product.says})` : "");
  return el("li", {}, el("span", {}, product.label), el("b", {}, `${rounded(shown.level)} ${shown.unit}`), spark(product),
    trend && el("small", { class: "soft" }, trend));
}

function spark(product) {
  if (product.items.length < 2) return el("span", {});
  const values = [...product.items].reverse().map((item) => item.value);
  const [low, high] = [Math.min(...values), Math.max(...values)];
  const x = (index) => MARGIN + (index * (WIDTH - 2 * MARGIN)) / Math.max(1, values.length - 1);
  const y = (value) => HEIGHT - MARGIN - ((value - low) / (high - low || 1)) * (HEIGHT - 2 * MARGIN);
  const root = svg("svg", { class: "spark", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": `${product.label}: ${values.length} values` });
  root.append(svg("polyline", { points: values.map((value, index) => `${x(index).toFixed(1)},${y(value).toFixed(1)}`).join(" ") }),
    svg("circle", { cx: x(values.length - 1), cy: y(values.at(-1)), r: 2.4 }));
  return root;
}
