// Small helpers: elements without innerHTML, numbers and times as a technician reads them, and the API.

export const $ = (id) => document.getElementById(id);

export function el(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "class") node.className = value;
    else if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (value !== null && value !== false) node.setAttribute(name, value === true ? "" : value);
  }
  node.append(...children.filter((child) => child !== null && child !== undefined && child !== ""));
  return node;
}

export function svg(tag, attributes = {}, ...children) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.append(...children);
  return node;
}

export const um = (metres, digits = 1) => (metres * 1e6).toFixed(digits);

// To a few digits, without an exponent for what a workshop measures.
export const rounded = (value, digits = 3) =>
  (Math.abs(value) >= 10 ** digits ? value.toFixed(0) : Number(value.toPrecision(digits)).toString());

const METHODS = { paper: "the paper's thresholds", model_fit: "the fit of the whole model", revised_model: "the revised model" };
export const byMethod = (method) => `by ${METHODS[method] ?? method}`;

// The half width where value ± half is true to a digit, both ends where it is not.
export function interval(value, ends) {
  if (!ends) return "";
  const [below, above] = [value - ends[0], ends[1] - value];
  const even = Math.abs(above - below) < 0.1 * (above + below);
  return even ? `± ${um((above + below) / 2)}` : `(${um(ends[0])} to ${um(ends[1])})`;
}

export function when(text) {
  if (!text) return "";
  const at = new Date(text);
  return at.toLocaleString([], { year: "numeric", month: "short", day: "numeric", hour: "2-digit", minute: "2-digit" });
}

export function day(milliseconds) {
  return new Date(milliseconds).toLocaleDateString([], { month: "short", day: "numeric" });
}

// A problem of the service in its own words; status 0 where it did not answer at all.
export class ApiError extends Error {
  constructor(status, detail) {
    super(detail);
    this.status = status;
  }
}

let asking = null;

function askToken() {
  asking ??= new Promise((resolve) => {
    const dialog = $("token-dialog");
    dialog.addEventListener("close", () => {
      sessionStorage.setItem("token", $("token").value);
      asking = null;
      resolve();
    }, { once: true });
    dialog.showModal();
  });
  return asking;
}

async function call(path, options = {}) {
  const token = sessionStorage.getItem("token");
  const headers = { ...options.headers, ...(token ? { Authorization: `Bearer ${token}` } : {}) };
  let response;
  try {
    response = await fetch(path, { ...options, headers });
  } catch {
    throw new ApiError(0, "the service does not answer");
  }
  if (response.status === 401) {
    await askToken();
    return call(path, options);
  }
  if (!response.ok) {
    const problem = await response.json().catch(() => ({}));
    throw new ApiError(response.status, problem.detail ?? response.statusText);
  }
  return response;
}

export const getJson = async (path) => (await call(path)).json();
export const getBlobUrl = async (path) => URL.createObjectURL(await (await call(path)).blob());
export const postJson = async (path, body, headers = {}) =>
  (await call(path, {
    method: "POST",
    headers: { "Content-Type": "application/json", ...headers },
    body: JSON.stringify(body),
  })).json();

// A page of the service in a new tab; with a token it is fetched, since a link carries none.
export async function openPage(event, path) {
  if (!sessionStorage.getItem("token")) {
    event.currentTarget.target = "_blank";
    return;
  }
  event.preventDefault();
  const tab = window.open("", "_blank");
  tab.location = await getBlobUrl(path);
}

const waiting = new WeakMap();

// Open a dialog of the page and wait until it is closed; true when it was confirmed.
// A close event comes late: opened again at once, the dialog must not take the one before for its own.
export function confirmed(dialog) {
  waiting.get(dialog)?.(false);
  return new Promise((resolve) => {
    waiting.set(dialog, resolve);
    dialog.onclose = () => {
      if (dialog.open) return;
      waiting.delete(dialog);
      resolve(dialog.returnValue === "ok");
    };
    dialog.returnValue = "";
    dialog.showModal();
  });
}
