// The page: asks the service every few seconds, every second while the machine moves, and shows what it says.

import { card } from "./cards.js";
import { $, confirmed, el, getJson, postJson, rounded } from "./dom.js";
import { runItem } from "./runs.js";

const IDLE_MS = 3000;
const BUSY_MS = 1000;
const PAGE_OF_RUNS = 12;

const state = { status: null, axesText: "", runsText: "", busyWith: null, older: [], cursor: null, notice: "" };

const actions = {
  blocked: () => state.status === null || state.status.progress !== null || state.status.not_ready.length > 0,

  async check(axis, moving) {
    const places = axis.diagnostic_positions_m;
    const where = places.length ? `travel to ${places.map((m) => `${m.toFixed(3)} m`).join(", ")} and back, and at each place ` : "";
    $("check-text").textContent = `${moving.join(" and ")} will ${where}make a row of short, sharp steps. `
      + "Make sure that nobody is in the machine, that it is idle, and that the way is free.";
    $("check-go").textContent = "Move and measure";
    if (!(await confirmed($("check-dialog")))) return;
    const key = crypto.randomUUID?.() ?? `${Date.now()}-${Math.random()}`;
    await act(() => postJson("/api/v1/checks", { axis: axis.name }, { "Idempotency-Key": key }));
  },

  async move(axis, moving, move) {
    const { length_m, jerk_m_s3, direction } = move;
    // Told apart along the travel: at the places where the axis steps for its map, if it does.
    const positions_m = move.position === "along the whole travel" ? axis.diagnostic_positions_m : [];
    const where = positions_m.length ? `travel to ${positions_m.map((m) => `${m.toFixed(3)} m`).join(", ")} and back, and there ` : "";
    $("check-text").textContent = `${moving.join(" and ")} will ${where}make a row of steps of ${(length_m * 1e3).toFixed(1)} mm with a jerk of `
      + `${rounded(jerk_m_s3)} m/s³${where ? "" : " where they stand"}, the first one ${direction > 0 ? "forth" : "back"}: ${move.why}. They are `
      + "no measurement of the backlash. Make sure that nobody is in the machine, that it is idle, and that the way is free.";
    $("check-go").textContent = "Move";
    if (!(await confirmed($("check-dialog")))) return;
    const body = { axis: axis.name, length_m, jerk_m_s3, direction, positions_m, position: move.position, why: move.why };
    await act(() => postJson("/api/v1/moves", body));
  },

  async acknowledge(alarm) {
    $("ack-text").textContent = `Axis ${alarm.axis}: ${alarm.detail}. This says that you have seen it; the alarm ends `
      + "only when measured values are back inside.";
    $("ack-by").value = localStorage.getItem("by") ?? "";
    $("ack-comment").value = "";
    if (!(await confirmed($("ack-dialog"))) || !$("ack-by").value.trim()) return;
    localStorage.setItem("by", $("ack-by").value);
    const seen = { by: $("ack-by").value.trim(), comment: $("ack-comment").value };
    await act(() => postJson(`/api/v1/alarms/${alarm.id}/acknowledge`, seen));
  },

  async decide(revision, how) {
    $("decide-title").textContent = how === "accept" ? "Accept the model revision" : "Reject the model revision";
    $("decide-text").textContent = how === "accept"
      ? `Axis ${revision.axis}: ${revision.in_words} From now on its values are computed with that; the earlier ones are `
        + "computed anew beside the old. Open alarms stay until new values end them."
      : `Axis ${revision.axis}: ${revision.in_words} The model stays as it is, and this finding is not proposed again.`;
    $("decide-by").value = localStorage.getItem("by") ?? "";
    $("decide-note").value = "";
    if (!(await confirmed($("decide-dialog"))) || !$("decide-by").value.trim()) return;
    localStorage.setItem("by", $("decide-by").value);
    const decision = { by: $("decide-by").value.trim(), note: $("decide-note").value };
    await act(() => postJson(`/api/v1/revisions/${revision.id}/${how}`, decision));
  },
};

async function act(what) {
  try {
    await what();
    state.notice = "";
  } catch (error) {
    state.notice = error.message;
  }
  await refresh();
}

function showMachine(status) {
  const { progress } = status;
  const bar = $("machine-progress");
  bar.hidden = progress === null || progress.total === 0;
  if (!bar.hidden) [bar.max, bar.value] = [progress.total, progress.done];
  $("machine-text").textContent = progress === null ? (status.not_ready.length ? "Not ready" : "Ready")
    : `Checking ${progress.target}: ${progress.phase}`;
  $("version").textContent = `Flankwatch ${status.version}`;
}

function showBanners(problems) {
  $("banners").replaceChildren(...problems.map(([text, tone]) => el("p", { class: `banner ${tone}` }, text)));
}

// Drawn again only when something changed, so that focus and open runs stay where they are.
async function showAxes() {
  const { items } = await getJson("/api/v1/axes");
  const text = JSON.stringify([items, actions.blocked()]);
  if (text === state.axesText) return;
  const focused = [...document.querySelectorAll("#axes button")].indexOf(document.activeElement);
  $("axes").replaceChildren(...(await Promise.all(items.map((axis) => card(axis, items, actions)))));
  if (focused >= 0) document.querySelectorAll("#axes button")[focused]?.focus();
  state.axesText = text;
}

async function showRuns() {
  const page = await getJson(`/api/v1/runs?limit=${PAGE_OF_RUNS}`);
  const text = JSON.stringify(page);
  if (text === state.runsText) return;
  const known = new Map([...$("runs").children].map((item) => [item.dataset.mark, item]));
  const newest = page.items.map((run) => known.get(`${run.id}/${run.state}`) ?? runItem(run));
  const last = page.items.at(-1)?.id ?? 0;
  const before = state.older.filter((run) => run.id < last).map((run) => known.get(`${run.id}/${run.state}`) ?? runItem(run));
  $("runs").replaceChildren(...newest, ...before);
  if (state.older.length === 0) state.cursor = page.next_cursor;
  $("more-runs").hidden = state.cursor === null;
  state.runsText = text;
}

async function showOlderRuns() {
  const page = await getJson(`/api/v1/runs?limit=${PAGE_OF_RUNS}&cursor=${state.cursor}`);
  state.older.push(...page.items);
  state.cursor = page.next_cursor;
  $("runs").append(...page.items.map(runItem));
  $("more-runs").hidden = state.cursor === null;
}

async function refresh() {
  const problems = [];
  try {
    state.status = await getJson("/api/v1/status");
    showMachine(state.status);
    problems.push(...state.status.not_ready.map((text) => [text, ""]));
    await Promise.all([showAxes(), showRuns()]);
    document.body.classList.remove("stale");
  } catch (error) {
    problems.push([`No fresh data: ${error.message}. What is shown may be old.`, ""]);
    $("machine-text").textContent = "No connection";
    document.body.classList.add("stale");
  }
  if (state.notice) problems.push([state.notice, "mild"]);
  showBanners(problems);
}

async function loop() {
  if (!document.hidden) await refresh();
  setTimeout(loop, state.status?.progress ? BUSY_MS : IDLE_MS);
}

// A link such as /#run-17 opens that run, once it is in the list.
function openLinkedRun() {
  const body = location.hash.startsWith("#run-") ? $(location.hash.slice(1)) : null;
  if (body?.hidden) body.previousElementSibling.click();
  body?.parentElement.scrollIntoView();
}

// A plain button, so that Enter in the form acknowledges; in the dialog before a move, Enter cancels.
$("ack-cancel").addEventListener("click", () => $("ack-dialog").close());
$("decide-cancel").addEventListener("click", () => $("decide-dialog").close());
$("more-runs").addEventListener("click", showOlderRuns);
window.addEventListener("hashchange", openLinkedRun);
await loop();
openLinkedRun();
