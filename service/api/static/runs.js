// The list of runs; one opens to its values, steps and pictures.

import { byMethod, el, getBlobUrl, getJson, interval, openPage, rounded, um, when } from "./dom.js";

const STATES = { queued: "waiting", running: "moving", ok: "measured", refused: "refused", failed: "failed" };

const why = (run) => (run.other_steps ? "separating move, no measurement" : run.kind === "nightly" ? "nightly" : "on demand");

export function runItem(run) {
  const body = el("div", { class: "run-body", id: `run-${run.id}`, hidden: true });
  const head = el("button", { class: "run-head", "aria-expanded": "false", "aria-controls": body.id },
    el("span", {}, `# ${run.id}`),
    el("span", {}, when(run.finished_at ?? run.requested_at)),
    el("span", { class: `state ${run.state}` }, STATES[run.state]),
    el("span", {}, run.axes.join(", ")),
    el("span", { class: "why" }, run.reason_in_words ?? why(run)),
    el("span", { class: "more", "aria-hidden": "true" }, "▾"));
  head.addEventListener("click", () => toggle(run, head, body));
  return el("li", { "data-mark": `${run.id}/${run.state}` }, head, body);
}

async function toggle(run, head, body) {
  body.hidden = !body.hidden;
  head.setAttribute("aria-expanded", String(!body.hidden));
  if (body.hidden || body.childElementCount > 0) return;
  try {
    body.append(...(await contents(await getJson(`/api/v1/runs/${run.id}`))));
  } catch (error) {
    body.append(el("p", { class: "note" }, error.message));
    body.addEventListener("click", () => body.replaceChildren(), { once: true });
  }
}

async function contents(run) {
  const parts = [];
  if (run.other_steps) parts.push(el("p", { class: "soft" }, otherSteps(run.other_steps)));
  if (run.detail) parts.push(el("p", { class: "note" }, run.detail));
  parts.push(...run.remarks.map((remark) => el("p", { class: "note" }, `${remark}.`)));
  parts.push(...inOrder(run.results).flatMap((result) => resultParts(run, result)));
  parts.push(...run.model_checks.map(modelCheck));
  if (run.capture_sha256) {
    parts.push(el("p", {}, el("button", { class: "quiet", onclick: () => download(run) }, "Download the recording")));
  }
  if (parts.length === 0) parts.push(el("p", { class: "soft" }, "Nothing was recorded in this run."));
  return parts;
}

// Axis by axis, the reported value first.
function inOrder(results) {
  const axes = [...new Set(results.map((result) => result.axis))];
  return [...results].sort((a, b) => axes.indexOf(a.axis) - axes.indexOf(b.axis) || b.reported - a.reported);
}

function otherSteps(steps) {
  return `Steps of ${(steps.length_m * 1e3).toFixed(1)} mm with a jerk of ${rounded(steps.jerk_m_s3)} m/s³, to tell two effects apart: `
    + "the values below measure nothing and stand in no trend.";
}

function modelCheck(check) {
  const found = Object.entries(check.in_words).map(([axis, words]) => `${axis}: ${words}`).join(" ");
  const state = check.state === "queued" || check.state === "running" ? "is being made" : check.state.replace("_", " ");
  const link = check.report && el("a", { href: check.report, onclick: (event) => openPage(event, check.report) }, "Show why");
  return el("p", { class: "soft" }, `Model check${check.train_run_ids.length ? `, fitted to run ${check.train_run_ids.join(" and ")}` : ""}: `
    + (found || `${state}${check.detail ? `: ${check.detail}.` : "."}`), " ", link);
}

function resultParts(run, result) {
  const text = result.backlash_m === null
    ? `no value. ${result.reason_in_words}`
    : `${um(result.backlash_m)} µm ${interval(result.backlash_m, result.interval_95_m)}`;
  const whose = run.results.some((other) => other.axis === result.axis && other.reported) ? "Beside it" : `Axis ${result.axis}`;
  if (!result.reported) return [el("p", { class: "soft" }, `${whose}, ${byMethod(result.method)}: ${text}`)];
  const parts = [el("h3", {}, `Axis ${result.axis}: ${text}`), el("p", { class: "soft" }, byMethod(result.method))];
  if (result.detail) parts.push(el("p", { class: "soft" }, result.detail));
  parts.push(...meaning(result));
  if (result.steps.length === 0) return parts;
  if (run.capture_sha256) parts.push(pictures(run, result));
  parts.push(el("div", { class: "scroll" }, stepTable(result)));
  return parts;
}

// What the value consists of: each direction, each place along the rack, and what else the fit found.
function meaning(result) {
  const ways = result.by_direction.map((part) =>
    `${part.direction > 0 ? "forth" : "back"} ${um(part.backlash_m)} µm ${interval(part.backlash_m, part.interval_95_m)}`);
  const parts = ways.length ? [el("p", { class: "soft" }, `By direction: ${ways.join(", ")}`)] : [];
  if (result.by_place.length > 1) {
    const place = (part) => [`${part.position_m.toFixed(3)} m`, part.backlash_m === null ? part.reason_in_words
      : `${um(part.backlash_m)} µm ${interval(part.backlash_m, part.interval_95_m)}`];
    parts.push(table("Along the rack", ["Position", "Backlash"], result.by_place.map(place)));
  }
  if (result.by_products.length) {
    const row = ({ label, shown }) => [label, `${rounded(shown.value)} ± ${rounded(shown.std, 1)} ${shown.unit}`];
    parts.push(table("Found beside it", ["Parameter", "Value"], result.by_products.map(row)));
  }
  return parts;
}

function table(caption, heads, rows) {
  return el("div", { class: "scroll" }, el("table", {}, el("caption", {}, caption),
    el("thead", {}, el("tr", {}, ...heads.map((name) => el("th", { scope: "col" }, name)))),
    el("tbody", {}, ...rows.map((cells) => el("tr", {}, ...cells.map((cell) => el("td", {}, cell)))))));
}

function stepTable(result) {
  const row = (step) => el("tr", {},
    el("td", {}, String(step.index + 1)),
    el("td", {}, step.direction > 0 ? "forth" : "back"),
    el("td", { class: "number" }, step.backlash_m === null ? "—" : `${um(step.backlash_m)} µm`),
    el("td", {}, step.reason_in_words ?? ""));
  return el("table", {},
    el("thead", {}, el("tr", {}, ...["Step", "Way", "Backlash", "If refused, why"].map((name) => el("th", { scope: "col" }, name)))),
    el("tbody", {}, ...result.steps.map(row)));
}

function pictures(run, result) {
  const image = el("img", { class: "picture", alt: "" });
  const label = el("span", { "aria-live": "polite" });
  let at = 0;
  const show = async () => {
    const step = result.steps[at];
    label.textContent = `Step ${step.index + 1} of ${result.steps.length}`;
    image.alt = `Motor and load acceleration of axis ${result.axis} in step ${step.index + 1}, where the flanks part and meet`;
    const query = `axis=${encodeURIComponent(result.axis)}&step=${step.index}`;
    try {
      const old = image.src;
      image.src = await getBlobUrl(`/api/v1/runs/${run.id}/picture?${query}`);
      if (old) URL.revokeObjectURL(old);
      image.hidden = false;
    } catch (error) {
      image.hidden = true;
      label.textContent = error.message;
    }
  };
  const turn = (by) => () => { at = (at + by + result.steps.length) % result.steps.length; show(); };
  show();
  return el("div", {}, image, el("div", { class: "pager" },
    el("button", { class: "quiet", onclick: turn(-1), "aria-label": "Previous step" }, "‹"), label,
    el("button", { class: "quiet", onclick: turn(1), "aria-label": "Next step" }, "›")));
}

async function download(run) {
  const url = await getBlobUrl(`/api/v1/runs/${run.id}/capture`);
  el("a", { href: url, download: `run-${run.id}.parquet` }).click();
  setTimeout(() => URL.revokeObjectURL(url), 60_000);
}
