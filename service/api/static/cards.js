// One card per axis: where its backlash stands, what is wrong, and what can be done.

import { curve } from "./chart.js";
import { byMethod, el, getJson, interval, openPage, um, when } from "./dom.js";
import { alongRack } from "./map.js";
import { byProducts } from "./products.js";

const STATES = {
  normal: ["No alarm", ""],
  unacknowledged: ["ALARM", "bad"],
  acknowledged: ["Alarm, acknowledged", "bad"],
  returned_unacknowledged: ["Alarm is over", "warn"],
};
const KINDS = { backlash_high: "Backlash too large", backlash_low: "Backlash too small", run_missing: "No measurement" };
const NO_REFERENCE = "no reference is set, so that no alarm can be raised";
const HISTORY = 90;

const histories = new Map();

// The histories of an axis, fetched again only when it has a new answer.
async function history(axis) {
  const mark = `${axis.series}/${axis.latest?.run_id}/${axis.latest?.method}`;
  const known = histories.get(axis.name);
  if (known?.mark === mark) return known;
  const path = `/api/v1/axes/${encodeURIComponent(axis.name)}`;
  const [values, products] = await Promise.all(
    ["history", "by-products"].map((what) => getJson(`${path}/${what}?limit=${HISTORY}`)));
  const found = { mark, values: values.items, products: products.items };
  histories.set(axis.name, found);
  return found;
}

export async function card(axis, axes, actions) {
  const { values, products } = await history(axis);
  return el("article", { class: `card ${axis.alarm_state}`, "aria-label": `Axis ${axis.name}` },
    head(axis), value(axis), trend(axis), hint(axis), refusal(axis), model(axis, axes, actions),
    ...axis.proposed.map((r) => proposal(r, axis, axes, actions)),
    ...axis.alarms.map((a) => alarm(a, actions)),
    curve(axis, values), map(axis), byProducts(axis, products), checkButton(axis, axes, actions));
}

function head(axis) {
  const [text, tone] = STATES[axis.alarm_state];
  const title = el("h3", {}, `Axis ${axis.name}`);
  if (axis.group !== axis.name) title.append(el("small", { class: "soft" }, `  ${axis.group}`));
  return el("div", { class: "top" }, title, el("span", { class: `chip ${tone}` }, text));
}

function value(axis) {
  const now = axis.current ?? axis.declared;
  if (now === null) return el("div", { class: "value" }, "—", el("small", {}, " not measured yet"));
  const box = el("div", {});
  box.append(
    el("div", { class: "value" }, um(now.backlash_m), el("small", {}, ` ${interval(now.backlash_m, now.interval_95_m)} µm`)),
    el("p", { class: "soft" }, `measured ${when(now.measured_at)}, run ${now.run_id}, ${byMethod(now.method)}`));
  if (axis.revision) box.append(el("p", { class: "soft" }, revisedText(axis)));
  return box;
}

function trend(axis) {
  const now = axis.current?.trend;
  if (!now) return axis.reference_m === null ? el("p", { class: "soft" }, NO_REFERENCE) : null;
  const parts = [`Trend ${um(now.level_m)} µm`];
  if (now.slope_m_per_day !== null) parts.push(slope(now));
  if (axis.reference_m !== null && axis.tolerance_m !== null) {
    parts.push(`to stay within ${um(axis.reference_m)} ± ${um(axis.tolerance_m)} µm`);
  } else {
    parts.push(NO_REFERENCE);
  }
  return el("p", { class: "soft" }, parts.join(", "));
}

function hint(axis) {
  return axis.tolerance_hint ? el("p", { class: "note" }, `${axis.tolerance_hint}.`) : null;
}

// With an accepted model revision: whose value this is, and what the declared model says beside it.
function revisedText(axis) {
  const by = `model revision ${axis.revision.id}, accepted by ${axis.revision.decided_by}`;
  if (axis.current === null) return `By the declared model still: the values with ${by} are being computed.`;
  const beside = axis.declared ? ` By the declared model: ${um(axis.declared.backlash_m)} µm.` : "";
  return `With ${by}.${beside}`;
}

// What the latest model check said; a clean one in few words, so that the others stand out.
function model(axis, axes, actions) {
  const check = axis.model_check;
  if (!check || axis.proposed.length > 0) return null;
  const found = check.in_words[axis.name];
  const text = `Model check of run ${check.run_id}: ${found ?? `cannot tell: ${check.detail ?? "this axis was not judged"}.`}`;
  const said = el("p", { class: found?.startsWith("Something") ? "note" : "soft" }, text, " ", page(check));
  const move = check.separating_moves[axis.name];
  return move ? el("div", { class: "note proposal" }, el("p", {}, text, " ", page(check)), moveButton(move, axis, axes, actions)) : said;
}

// What tells two effects apart that look alike in the ordinary steps.
function moveButton(move, axis, axes, actions) {
  return el("button", { disabled: actions.blocked(), onclick: () => actions.move(axis, together(axis, axes), move) }, "Make the move that tells them apart");
}

function page(found) {
  return found.report ? el("a", { href: found.report, onclick: (event) => openPage(event, found.report) }, "Show why") : null;
}

function proposal(revision, axis, axes, actions) {
  const text = `${revision.in_words} Confirmed by a second verdict, on run ${revision.run_id}.`;
  return el("div", { class: "note proposal" }, el("p", {}, text, " ", page(revision)),
    el("button", { onclick: () => actions.decide(revision, "accept") }, "Accept"),
    el("button", { onclick: () => actions.decide(revision, "reject") }, "Reject"),
    revision.separating_move && moveButton(revision.separating_move, axis, axes, actions));
}

// A slope whose interval holds zero is not stated as one.
function slope(now) {
  const [low, high] = now.slope_interval_95_m_per_day;
  if (low <= 0 && high >= 0) return "steady";
  const month = now.slope_m_per_day * 30;
  return `${month > 0 ? "growing" : "shrinking"} ${um(Math.abs(month))} µm a month`;
}

// Where along the rack the gap is how wide; nothing where it was measured at one place.
function map(axis) {
  if (axis.by_place.length === 0) return null;
  return el("figure", {}, el("figcaption", { class: "soft" }, "Along the rack"), alongRack(axis));
}

function refusal(axis) {
  const last = axis.latest;
  if (!last || last.verdict === "ok") return null;
  return el("p", { class: "note" }, `The latest run (${last.run_id}, ${when(last.measured_at)}) gave no value. ${last.reason_in_words}`);
}

function alarm(found, actions) {
  const text = `${KINDS[found.kind] ?? found.kind} since ${when(found.raised_at)}: ${found.detail}. ${ending(found)}`;
  const box = el("div", { class: `alarm ${found.active ? "" : "over"}` }, el("span", {}, text));
  if (!found.acknowledged) {
    box.append(el("button", { onclick: () => actions.acknowledge(found), "aria-label": `Acknowledge: ${text}` }, "Acknowledge"));
  }
  return box;
}

function ending(found) {
  const over = found.active ? "" : `Over since ${when(found.cleared_at)}. `;
  return over + (found.acknowledged ? `Seen by ${found.acknowledged_by}.` : "");
}

const together = (axis, axes) => axes.filter((other) => other.group === axis.group).map((other) => other.name);

function checkButton(axis, axes, actions) {
  const moving = together(axis, axes);
  const label = moving.length > 1 ? `Check ${moving.join(" and ")} now` : `Check ${axis.name} now`;
  return el("button", { class: "main check", disabled: actions.blocked(), onclick: () => actions.check(axis, moving) }, label);
}
